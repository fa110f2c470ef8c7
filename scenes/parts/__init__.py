"""What scenes share: furniture, houses, trees, light."""
