"""How a transient is brought to its end: methods as data, and the choice among them."""
