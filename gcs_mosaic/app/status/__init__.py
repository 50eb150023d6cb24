"""What is told of a running flight: terminal, status.json, its log, the ground station, the service manager."""
