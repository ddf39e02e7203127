"""From which starts does each law converge?"""
