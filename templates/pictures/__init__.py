"""Programs for black-and-white pictures: one channel, "picture", +1 black and -1 white."""
