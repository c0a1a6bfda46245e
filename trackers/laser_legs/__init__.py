"""People by their legs, from low scanners that stand or drive: a classifier of clusters, a map, and one measure of existence."""
