"""Array drivers: each turns the bytes or text of one kind of tactile array into frames."""

from cnnum.drivers.driver import Counters, Driver
from cnnum.drivers.registry import driver_names, driver_options, open_driver

__all__ = ["Counters", "Driver", "driver_names", "driver_options", "open_driver"]
