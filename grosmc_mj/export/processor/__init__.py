"""An exported law on the processor of a controller, which QEMU emulates."""
