"""One HTML file of results: it opens offline, and begins with the answer.

`reading` reads the documents in files and folders, `charts` turns their charts into Plotly's data,
`write` fills the template `page.html`.
"""
