"""Battery power, temperatures and state of charge."""
