"""The template library: one TOML file a template; `tactile` holds the analogic programs."""
