"""The regression: candidates, nuisance columns with their priors, row weights, and the fit."""
