"""Campaigns: thousands of uncertain plants, stored in parts, and what they show of each law."""
