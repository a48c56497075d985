"""Rules of a cell and its neighbours, written as text in a template's check."""
