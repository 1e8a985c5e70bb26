"""Colours of our raw files in other people's converters.

Photographs the embedded colour chart under D50, D65 and A, develops the DNG with dcraw, LibRaw, RawTherapee and darktable (linear,
as-shot white balance, sRGB) and prints the mean and largest CIEDE2000 of the 24 patches against their spectra, after one factor
of brightness from the grey row. Also checks that LibRaw reads every stored form bit for bit alike.

    apt install dcraw libraw-bin darktable rawtherapee libimage-exiftool-perl
    pip install "numpy" rawpy tifffile pillow
    python validation/converters.py [BODY ...]        # from the root of the project, after cargo build --release

Sources: CIEDE2000 of Sharma, Wu & Dalal 2005; Bradford adaptation of Lindbloom.
"""
import csv, os, subprocess, sys, tempfile
import numpy as np
from PIL import Image

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
DIOPTER = os.path.join(ROOT, 'target/release/diopter')
TABLES = os.path.join(ROOT, 'crates/light/src/cie/')


def table(name):
    rows = [r for r in csv.reader(open(TABLES + name)) if r and not r[0].startswith('#')]
    return [h.strip() for h in rows[0]], np.array([[float(x) for x in r] for r in rows[1:]])


_, CMF = table('cie1931_2deg_1nm.csv')
LIGHTS, ILL = table('illuminants_5nm.csv')
_, PATCHES = table('colorchecker24_babelcolor_avg_10nm.csv')
NM = np.arange(380, 781)
OBSERVER = np.array([np.interp(NM, CMF[:, 0], CMF[:, k]) for k in (1, 2, 3)])
BRADFORD = np.array([[.8951, .2664, -.1614], [-.7502, 1.7135, .0367], [.0389, -.0685, 1.0296]])
D65 = np.array([.95047, 1, 1.08883])
XYZ_FROM_SRGB = np.array([[.4124564, .3575761, .1804375], [.2126729, .7151522, .0721750], [.0193339, .1191920, .9503041]])


def truth(light):
    """XYZ of the patches adapted to D65, white 1."""
    e = np.interp(NM, ILL[:, 0], ILL[:, LIGHTS.index(light)])
    r = np.array([np.interp(NM, PATCHES[:, 0], PATCHES[:, k + 1]) for k in range(24)])
    white = OBSERVER @ e
    xyz = (r * e) @ OBSERVER.T / white[1]
    m = np.linalg.inv(BRADFORD) @ np.diag((BRADFORD @ D65) / (BRADFORD @ (white / white[1]))) @ BRADFORD
    return xyz @ m.T


def lab(xyz):
    t = xyz / D65
    f = np.where(t > 216 / 24389, np.cbrt(t), (24389 / 27 * t + 16) / 116)
    return np.stack([116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])], 1)


def de2000(l1,l2):
    L1,a1,b1=l1.T;L2,a2,b2=l2.T
    C1=np.hypot(a1,b1);C2=np.hypot(a2,b2);Cb=(C1+C2)/2;G=.5*(1-np.sqrt(Cb**7/(Cb**7+25**7)))
    a1p=(1+G)*a1;a2p=(1+G)*a2;C1p=np.hypot(a1p,b1);C2p=np.hypot(a2p,b2)
    h1=np.degrees(np.arctan2(b1,a1p))%360;h2=np.degrees(np.arctan2(b2,a2p))%360
    dL=L2-L1;dC=C2p-C1p;dh=h2-h1;dh=np.where(dh>180,dh-360,np.where(dh<-180,dh+360,dh))
    dH=2*np.sqrt(C1p*C2p)*np.sin(np.radians(dh/2))
    Lp=(L1+L2)/2;Cp=(C1p+C2p)/2;s=h1+h2;hp=np.where(abs(h1-h2)<=180,s/2,np.where(s<360,(s+360)/2,(s-360)/2))
    T=1-.17*np.cos(np.radians(hp-30))+.24*np.cos(np.radians(2*hp))+.32*np.cos(np.radians(3*hp+6))-.2*np.cos(np.radians(4*hp-63))
    dt=30*np.exp(-((hp-275)/25)**2);Rc=2*np.sqrt(Cp**7/(Cp**7+25**7));Sl=1+.015*(Lp-50)**2/np.sqrt(20+(Lp-50)**2)
    Sc=1+.045*Cp;Sh=1+.015*Cp*T;Rt=-np.sin(np.radians(2*dt))*Rc
    return np.sqrt((dL/Sl)**2+(dC/Sc)**2+(dH/Sh)**2+Rt*(dC/Sc)*(dH/Sh))


def patches(path):
    """Linear sRGB of the patches of a picture."""
    import tifffile
    a = (tifffile.imread(path) if path.endswith(('.tif', '.tiff')) else np.asarray(Image.open(path))).astype(float)[..., :3]
    a /= 65535 if a.max() > 255 else 255
    height, width, _ = a.shape
    # 100 mm before a chart 0.95 m away, 36 mm across.
    px_per_m = width / 36e-3 * (0.1 / (0.95 - 0.1))
    out = []
    for i in range(24):
        x, y = width / 2 + (i % 6 - 2.5) * .044 * px_per_m, height / 2 - (1.5 - i // 6) * .044 * px_per_m
        r = .013 * px_per_m
        out.append(a[int(y - r):int(y + r), int(x - r):int(x + r)].reshape(-1, 3).mean(0))
    v = np.array(out)
    return np.where(v <= .04045, v / 12.92, ((v + .055) / 1.055) ** 2.4)


def score(path, light):
    seen, true = patches(path) @ XYZ_FROM_SRGB.T, truth(light)
    d = de2000(lab(seen * true[18:, 1].sum() / seen[18:, 1].sum()), lab(true))
    return d.mean(), d.max()


def develop(name):
    """Pictures of a DNG by converter."""
    import rawpy, tifffile
    quiet = dict(capture_output=True, text=True)
    subprocess.run(['dcraw', '-w', '-o', '1', '-H', '0', '-6', '-W', '-g', '2.4', '12.92', '-T', name + '.dng'], check=True, **quiet)
    yield 'dcraw', name + '.tiff'
    with rawpy.imread(name + '.dng') as raw:
        picture = raw.postprocess(use_camera_wb=True, output_color=rawpy.ColorSpace.sRGB, no_auto_bright=True, gamma=(2.4, 12.92), output_bps=16)
    tifffile.imwrite(name + '-libraw.tif', picture)
    yield 'LibRaw', name + '-libraw.tif'
    with open('linear.pp3', 'w') as f:
        f.write('[Version]\nAppVersion=5.9\nVersion=346\n[Exposure]\nAuto=false\nClip=0\nCompensation=0\nCurve=0;\nHistogramMatching=false\n'
                '[White Balance]\nEnabled=true\nSetting=Camera\n[Color Management]\nInputProfile=(cameraICC)\nToneCurve=false\n'
                'ApplyLookTable=false\nApplyBaselineExposureOffset=false\nApplyHueSatMap=false\nWorkingProfile=ProPhoto\n'
                'OutputProfile=RTv4_sRGB\n[RAW]\nCA=false\n')
    subprocess.run(['rawtherapee-cli', '-Y', '-t', '-b16', '-o', name + '-rt.tif', '-p', 'linear.pp3', '-c', name + '.dng'], **quiet)
    yield 'RawTherapee', name + '-rt.tif'
    subprocess.run(['darktable-cli', name + '.dng', name + '-dt.tif', '--icc-type', 'SRGB', '--core', '--configdir', 'dt', '--conf',
                    'plugins/darkroom/workflow=none', '--conf', 'plugins/darkroom/chromatic-adaptation=legacy', '--conf',
                    'plugins/imageio/format/tiff/bpp=16'], **quiet)
    yield 'darktable', name + '-dt.tif'


def bit_exact(body):
    import rawpy
    subprocess.run([DIOPTER, 'expose', 'color-chart', '--body', body, '--size', '900x600', '--spp', '1', '-o', 'plane.exr'], check=True, capture_output=True)
    numbers = []
    for how in ('16', 'packed', 'lossless'):
        subprocess.run([DIOPTER, 'read-out', 'plane.exr', '--dng', how, '-o', how + '.dng'], check=True, capture_output=True)
        with rawpy.imread(how + '.dng') as raw:
            numbers.append(raw.raw_image.copy())
        said = subprocess.run(['exiftool', '-validate', '-warning', how + '.dng'], capture_output=True, text=True).stdout
        print(f'{body} {how:8} exiftool: {said.split(":")[1].strip().splitlines()[0]}')
    print(f'{body} LibRaw: the three forms are the same:', all((n == numbers[0]).all() for n in numbers))


if __name__ == '__main__':
    os.chdir(tempfile.mkdtemp())
    for body in sys.argv[1:] or ['canon-5d-mark-iv', 'nikon-d850', 'canon-t2i']:
        bit_exact(body)
        for light in ('D50', 'D65', 'A'):
            name = f'{body}-{light}'
            subprocess.run([DIOPTER, 'shoot', f'color-chart-{light.lower()}', '--body', body, '--white', light, '--format', '36x24', '--size',
                            '900x600', '--spp', '16', '--tone', 'linear', '-o', name + '.dng', '-o', name + '.png'], check=True, capture_output=True)
            for who, path in [('diopter', name + '.png'), *develop(name)]:
                print(f'{body} {light} {who:12} mean {score(path, light)[0]:.2f} largest {score(path, light)[1]:.2f}')
