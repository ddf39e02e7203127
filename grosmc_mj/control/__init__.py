"""The theory, without MuJoCo: from a task (plant, error coordinates, weights) to a law.

``design`` makes controllers, ``laws`` has their equations, ``switching`` and ``surface`` the
sliding mode, ``gains`` what the declared uncertainty asks for, ``coordinates`` the error state z.
"""
