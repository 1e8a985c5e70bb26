"""Our flat fields and darks, measured by the EMVA 1288 reference implementation.

    pip install "numpy<2" "scipy<1.14" emva1288 pillow        # emva1288 1.0.2 does not run with numpy 2
    python validation/emva.py [BODY ...]                      # from the root of the project, after cargo build --release

Prints what that program and `diopter body emva` measure beside what the data sheet says.
"""
import json, logging, os, subprocess, sys, tempfile

logging.disable(logging.CRITICAL)
from emva1288 import process

DIOPTER = os.path.join(os.path.dirname(os.path.dirname(os.path.abspath(__file__))), 'target/release/diopter')

for body in sys.argv[1:] or ['imx249', 'imx255', 'canon-t2i', 'hwk4123']:
    with tempfile.TemporaryDirectory() as folder:
        stack = os.path.join(folder, 'stack')
        said = subprocess.run([DIOPTER, 'body', 'emva', body, '--export', stack, '--json'], check=True, capture_output=True, text=True)
        ours = json.loads(said.stdout)
        info = process.ParseEmvaDescriptorFile(os.path.join(stack, 'description.txt'))
        r = process.Results1288(process.Data1288(process.LoadImageData(info.images).data).data)
        theirs = dict(gain_dn_per_e=r.K, quantum_efficiency=r.QE / 100, dark_noise_e=r.sigma_d, saturation_capacity_e=r.u_e_sat,
                      dsnu_e=r.DSNU1288, prnu_percent=r.PRNU1288)
        for key, value in theirs.items():
            put, own = ours['sheet'][key], ours['measured'][key]
            off = lambda v: f'{100 * (v / put - 1):+.2f} %' if put > 0.005 else ''
            print(f'{body:12} {key:24} sheet {put:12.5f}   emva1288 {value:12.5f} {off(value):>9}   diopter {own:12.5f} {off(own):>9}')
