"""Ends of transients that are known without a time step."""
