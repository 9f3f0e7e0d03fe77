"""What people write and read: scene, profile, certificate, perception table, hand; errors."""
