"""What a vehicle measures: sound in the sea, bearings, ranges, differences of arrival."""
