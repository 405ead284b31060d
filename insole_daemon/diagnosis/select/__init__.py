"""Which terms a recording needs: candidates with penalties, search over sets, tests of the residual."""
