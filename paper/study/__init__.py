"""Studies of section 6.2 on trained policies: tables 2 and 3 and the learning curves of figure 5."""
