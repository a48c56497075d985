"""Array drivers: each turns the bytes or text of one kind of tactile array into frames."""
