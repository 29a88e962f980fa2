"""Many operating points on one machine or a cluster: what is to be done, where results are kept, how they are run."""
