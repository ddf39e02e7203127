"""How accurate is each switching law, and how much does it chatter?"""
