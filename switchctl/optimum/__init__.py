"""The optimal switching sequence: its lower bounds, its upper bounds and the search between them."""
