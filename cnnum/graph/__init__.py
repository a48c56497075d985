"""Analogic programs as graphs: nodes, the passes that thin them out, and the schedule left."""
