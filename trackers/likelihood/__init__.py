"""Likelihoods, one module per kind of evidence: each has frozen options of its own and `log_likelihood`; none knows a system."""
