"""The cart-pendulum, and laws of its own that hold the cart too."""
