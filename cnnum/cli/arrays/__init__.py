"""The commands of arrays that are offered, shown and packed."""
