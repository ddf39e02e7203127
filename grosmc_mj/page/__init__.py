"""One HTML file of results: it opens offline, and begins with the answer.

What lies in a path is read as documents (`reading`, `documents`), told as answers (`answers`) and
charts (`charts`, `campaigns`), and written with one script of Plotly's (`write`, `page.html`).
"""
