"""What a vehicle or a team believes: dilution of precision, filters, maps."""
