"""Measuring: error against run time, throughput, latency, compile time, growth, and the peers."""
