"""Statements as C99, and a program as a folder of files."""
