"""The data center: MAML on raw observations from the uplink, meta-model to the downlink."""
