"""The uncertain plants: what is asked for, which numbers vary, and each sample of them."""
