"""Likelihoods, one module per kind of evidence: each with its frozen options and `log_likelihood`, independent of any
system.
"""
