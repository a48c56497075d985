"""What a device itself can do: its peak of multiply-adds, its bandwidth, and an empty launch."""
