"""The regression: the load that columns are made from, base terms with their priors, weights, and the fit."""
