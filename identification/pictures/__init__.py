"""Pictures of logs, of how well a device explains them, and of what is known of the device."""
