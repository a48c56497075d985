"""Pictures of a report, as SVG: charts, maps, time lines."""
