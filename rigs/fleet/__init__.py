"""Clusters of real brokers, their failures, and a fleet of bridges on one of them."""
