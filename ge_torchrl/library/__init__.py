"""What `import ge_torchrl` offers: functions and results, thin over the rooms below."""
