"""The paper's structure: one network per load in two stages [EF15 Eqs. 1-7]."""
