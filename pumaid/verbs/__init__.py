"""What a user can ask for: one public function a module, of the same name."""
