"""Diagnosis of real recordings whose makers published what a rigid nominal model lacks."""
