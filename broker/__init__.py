"""The MQTT broker of JouleSwarm: amqtt with its own delivery path and exact byte counters."""
