"""Videos of others as events: frames with times, the light they stand for, a sensor behind it."""
