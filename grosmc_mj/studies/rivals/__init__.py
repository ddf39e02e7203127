"""What does GROSMC win over the usual laws for unknown loads, all tuned by one rule?"""
