"""What changed from old results to new ones, and which of it is more than noise?"""
