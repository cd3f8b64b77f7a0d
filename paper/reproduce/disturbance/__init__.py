"""The disturbances of section 6.3: the simulated push (table 4, figure 6, section 3.2) and the falling mass."""
