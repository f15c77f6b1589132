"""Commissioning at a panel, without a bridge: scan, EEPROM, settings of single modules."""
