"""dm_control's cart-pole, as an example of a plant from elsewhere."""
