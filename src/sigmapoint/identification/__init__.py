"""Models that are not known: their parameters as unknowns, estimated beside the states or from the likelihood."""
