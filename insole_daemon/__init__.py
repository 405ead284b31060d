"""Real-time acquisition for a sensorised insole."""
