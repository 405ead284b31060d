"""What the sensor does to a load: counts into pressure."""
