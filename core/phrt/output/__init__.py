"""Pictures out: tone mapping, PNG, EXR, video, and the folder of layers. Imported when something is written."""
