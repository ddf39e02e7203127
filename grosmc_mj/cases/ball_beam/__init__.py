"""A ball on a beam, as an example of laws that believe in another model than the true one."""
