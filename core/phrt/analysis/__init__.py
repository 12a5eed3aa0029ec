"""The paper's offline phases: which objects and effects pay, looked up in the scene and measured in small probe frames."""
