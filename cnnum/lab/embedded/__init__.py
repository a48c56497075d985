"""What programs cost on a microcontroller, at which error: exports, counts and event scores."""
