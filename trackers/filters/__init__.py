"""Estimation core, batched over people: motion models, IMM of extended Kalman filters, particle filter, gating and
assignment.
"""
