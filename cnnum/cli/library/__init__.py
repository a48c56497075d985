"""The commands of `cnnum templates`, one module each."""
