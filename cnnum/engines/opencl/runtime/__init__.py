"""Which OpenCL devices work: each shows it in a process of its own before it is used."""
