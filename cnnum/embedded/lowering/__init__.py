"""From a schedule of the graph to statements, level by level."""
