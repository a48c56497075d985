"""Objects as others take them: datasets, tables, HTML of notebooks, and plots.

Heavy libraries are imported when one of these is asked for.
"""
