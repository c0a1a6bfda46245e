"""The estimation core, batched over people: motion models, the IMM of extended Kalman filters, gating and assignment."""
