"""cnnum: an emulator of the cellular-wave computer that processes tactile scenes."""
