class Probes:
    def __init__(self,n): pass
