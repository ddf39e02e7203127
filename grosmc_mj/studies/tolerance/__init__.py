"""How far from ideal may the loop be before a law breaks its promise?"""
