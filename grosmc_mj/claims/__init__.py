"""The chapter's claims, each with a verdict, and the premises that they rest on."""
