"""phrt-saliency: a heuristic for PHRT that traces first what stands out to the eye.

`phrt_saliency.model.saliency` is the model by itself: a picture in, a map of what stands out in it.
"""
