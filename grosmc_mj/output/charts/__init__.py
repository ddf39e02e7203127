"""One description of a chart; printed figures and those of a page are drawn from it."""
