"""Stokes vectors of some rays by Mitsuba 3 in its polarised mode: the table of `crates/scene/tests/it/polarized_transport.rs`.

    pip install mitsuba numpy
    python polarization_mitsuba.py

Prints, for each ray from (0, 2.6, 6), the point it goes through and I, Q, U, V over the light around, x to the right. Checked with Mitsuba 3.9.1.
"""
import mitsuba as mi
import numpy as np

mi.set_variant('scalar_spectral_polarized')
T = mi.ScalarTransform4f
EYE = [0, 2.6, 6]
THROUGH = [(0, 0, 2.6), (-1.4, 0.95, 0.5), (0, 0.42, 0), (-0.35, 0.6, 0), (1.7, 0.4, 0.6), (-1.75, 0.3, 0.5), (-1.3, 0, 1.2), (1.3, 0.6, 0.5)]


def spectrum(value):
    return {'type': 'uniform', 'value': float(value)}


def ball(x, z, bsdf):
    return {'type': 'sphere', 'center': [x, 0.75, z], 'radius': 0.7, 'bsdf': bsdf}


def metal(eta, k, **more):
    return {'type': 'conductor', 'eta': spectrum(eta), 'k': spectrum(k), **more}


scene = mi.load_dict({
    'type': 'scene',
    'sky': {'type': 'constant', 'radiance': spectrum(1)},
    'floor': {'type': 'rectangle', 'to_world': T().rotate([1, 0, 0], -90).scale(40), 'bsdf': metal(1.333, 0)},
    'glass': ball(-1.7, 0, {'type': 'dielectric', 'int_ior': 1.5, 'ext_ior': 1.0}),
    'metal': ball(0, -0.6, metal(0.6, 2.5)),
    'rough': ball(1.7, 0, metal(2.9, 3.0, type='roughconductor', distribution='ggx', alpha=0.2)),
})
integrator = mi.load_dict({'type': 'stokes', 'inner': {'type': 'path', 'max_depth': 13, 'rr_depth': 100}})


def stokes(through, samples):
    sensor = mi.load_dict({
        'type': 'perspective',
        'fov': 0.002,
        'to_world': T().look_at(origin=EYE, target=list(through), up=[0, 1, 0]),
        'film': {'type': 'hdrfilm', 'width': 1, 'height': 1, 'rfilter': {'type': 'box'}},
        'sampler': {'type': 'independent', 'sample_count': samples},
    })
    pixel = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=samples, seed=11))[0, 0]
    # Green of R, G, B of I, Q, U, V, behind the picture's own three channels.
    return pixel[3:].reshape(4, 3)[:, 1]


light = stokes((0, 5.5, -9), 20_000)[0]
for through in THROUGH:
    print(through, *(f'{v:.5f}' for v in stokes(through, 60_000) / light))
