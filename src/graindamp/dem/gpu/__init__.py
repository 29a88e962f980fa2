"""Hundreds of worlds on one GPU: the same contact laws, walls and motions as on the processor, one thread block per
world. What a user calls is :func:`graindamp.dem.gpu.batch.simulate_batch`; everything here needs the extra `gpu`."""
