"""The limits of a device: its peak of multiply-adds, its bandwidth, and an empty launch."""
