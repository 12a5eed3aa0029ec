class ShadowMaps:
    def __init__(self,n): pass
