"""What the two programs are required to do, and the tests and figures that say so.

`requirements.yaml` lists the requirements; `requirements` reads it and looks for its tests and
records, `page` makes the page of evidence.
"""
