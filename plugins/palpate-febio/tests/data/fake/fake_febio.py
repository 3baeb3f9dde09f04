"""Behaves like febio4 as far as palpate can see: reads a deck, writes a log and records, or misbehaves.

FAKE_FEBIO holds words that choose the behaviour; see ``main``. Its mechanics: stresses of the probe's
cubes are exact; a press has force c d^1.5 with c proportional to the first material's modulus, a twist
has torque c d β, times 1/n_steps under penalty friction, which forgets.
"""

import os
import signal
import sys
import time
import xml.etree.ElementTree as ET

import numpy as np

WORDS = os.environ.get("FAKE_FEBIO", "").split()
VERSION = next((w.removeprefix("version=") for w in WORDS if w.startswith("version=")), "4.11.0.65622b536")
GOOD = "\n N O R M A L   T E R M I N A T I O N\n\n"
BAD = "\n E R R O R   T E R M I N A T I O N\n\n"
BOX = " " + 73 * "*"


def boxed(kind, text):
    return f"\n{BOX}\n *{kind:^71}*\n * {text:<70}*\n{BOX}\n\n"


def main(arguments):
    if "-info" in arguments:
        print(f"compiled on Jan  1 2026\nFEBio version  = {VERSION}")
        return 1
    if "say_nothing" in WORDS:
        return 0
    print(f"  version {VERSION}", flush=True)
    if "xml_error" in WORDS:
        print(
            "Reading file job.feb ...FAILED!\nFATAL ERROR: unrecognized tag <rigid_bc> (line 7)", flush=True
        )
        return 1
    if "flood" in WORDS:
        for _ in range(3000):
            print("x" * 1000)
    root = ET.parse(arguments[arguments.index("-i") + 1]).getroot()
    with open(arguments[arguments.index("-o") + 1], "w") as log:
        return probe(root, log) if root.find("Rigid") is None else press(root, log)


# ----------------------------------------------------------------------- probe


def values(material):
    elastic = material.find("elastic")  # of what relaxes; the relaxation is left out
    material = material if elastic is None else elastic
    return {child.tag: float(child.text) for child in material if child.tag not in ("center_of_mass",)}


def cauchy(material, F):
    kind, c = material.get("type"), values(material)
    J, B = np.linalg.det(F), F @ F.T
    if kind == "neo-Hookean":
        mu, lame = c["E"] / 2 / (1 + c["v"]), c["E"] * c["v"] / (1 + c["v"]) / (1 - 2 * c["v"])
        return (mu * (B - np.eye(3)) + lame * np.log(J) * np.eye(3)) / J
    if kind == "Yeoh":
        B = J ** (-2 / 3) * B
        x = np.trace(B) - 3
        ks = [(k, c.get(f"c{k}", 0.0)) for k in range(1, 7)]
        slope = sum(v * x ** (k - 1) * (k if "textbook_yeoh" in WORDS else 1) for k, v in ks)
        slope *= 1.1 if "odd_yeoh" in WORDS else 1.0
        S = 2 / J * slope * B
    else:
        squares, axes = np.linalg.eigh(B)
        bar = J ** (-1 / 3) * np.sqrt(squares)
        t = sum(c[f"c{k}"] / c[f"m{k}"] * bar ** c[f"m{k}"] for k in range(1, 7) if f"c{k}" in c) / J
        S = axes @ np.diag(t) @ axes.T
    return S - np.trace(S) / 3 * np.eye(3) + c["k"] * np.log(J) / J * np.eye(3)


def count(what):
    file = os.environ.get("FAKE_FEBIO_COUNT")
    if file:
        with open(file, "a") as stream:
            stream.write(f"{what}\n")


def probe(root, log):
    count("probe")
    material = root.find("Material/material")
    n = int(root.findtext("Control/time_steps"))
    for bc, record in zip(
        root.findall("Boundary/bc"), root.findall("Output/logfile/element_data"), strict=False
    ):
        F = np.array(bc.findtext("F").split(","), dtype=float).reshape(3, 3)
        with open(record.get("file"), "w") as stream:
            for k in range(1, n + 1):
                s = cauchy(material, np.eye(3) + k / n * (F - np.eye(3)))
                row = [s[0, 0], s[1, 1], s[2, 2], s[0, 1], s[1, 2], s[0, 2]]
                stream.write(f"*Step  = {k}\n*Time  = {k}\n*Data  = sx;sy;sz;sxy;syz;sxz\n")
                stream.write(f"{record.text}," + ",".join(f"{v:.12g}" for v in row) + "\n")
    log.write(GOOD)
    print(GOOD)
    return 0


# ----------------------------------------------------------------------- press


def curve(root, number):
    points = root.findall(f"LoadData/load_controller[@id='{number}']/points/pt")
    return np.array([p.text.split(",") for p in points], dtype=float)


def answer(root, depth, turn):
    c = values(root.find("Material/material"))
    stiffness = c.get("c1", c.get("E"))
    contact = root.find("Contact/contact")
    friction = 1.0 if contact is None else float(contact.findtext("fric_coeff"))
    forgets = contact is not None and contact.findtext("laugon") == "PENALTY"
    twist = friction * (turn - np.concatenate([[0.0], turn[:-1]]) if forgets else turn)
    return stiffness * depth**1.5, stiffness * depth * twist


def press(root, log):
    count("run")
    for word, act in (("hang", hang), ("stubborn", stubborn), ("crash", crash), ("child", child)):
        if word in WORDS:
            act()
    full_newton = root.find("Control/solver/qn_method").get("type") == "full Newton"
    times, depth = curve(root, 1).T
    turn = curve(root, 2)[:, 1]
    force, torque = answer(root, depth, turn)
    if "zeros" in WORDS:
        force = torque = 0.0 * force
    if "nan" in WORDS:
        force = np.where(times == times[-2], np.nan, force)
    elsewhere = 0.5 if "elsewhere" in WORDS else 0.0
    broyden_fails = "broyden_fails" in WORDS and not full_newton
    last = len(times) // 2 if "diverge" in WORDS or broyden_fails or "cut" in WORDS else len(times)
    with open(root.find("Output/logfile/rigid_body_data").get("file"), "w") as stream:
        for k in range(last):
            stream.write(f"*Step  = {k}\n*Time  = {times[k]:.9g}\n*Data  = z;thz;Fx;Fy;Fz;Mx;My;Mz\n")
            row = [7.5 - depth[k] - elsewhere * (k > 1), turn[k], 0.0, 0.0, -force[k], 0.0, 0.0, torque[k]]
            garbled = "garbled" in WORDS and k == 3
            stream.write(
                "2," + ("\x00\x1b[Hrubbish" if garbled else ",".join(f"{v:.12g}" for v in row)) + "\n"
            )
        if "cut" in WORDS:
            stream.write("*Step  = 99\n*Time  = 99\n*Data  = z;thz;Fx;Fy;Fz;Mx;My;Mz\n2,7.1,0")
    return end(log, times[last - 1], failed=last < len(times))


def end(log, time_reached, failed):
    log.write(f"  version {VERSION}\n" + boxed("WARNING", "dtmax is ignored when specifying must points."))
    log.write(f"\n------- converged at time : {time_reached:g}\n\n")
    if failed and "silent_end" not in WORDS and "cut" not in WORDS:
        log.write(boxed("ERROR", "Negative jacobian was detected at element 12 at gauss point 3"))
        log.write(
            f"------- failed to converge at time : {time_reached + 0.25:g}\n\nMax. nr of retries reached.\n\n"
        )
        log.write(BAD)
        return 1
    if "cut" in WORDS:
        return 0
    log.write("" if "no_banner" in WORDS else GOOD)
    return 3 if "bad_code" in WORDS else 0


def hang():
    time.sleep(600)


def stubborn():
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    time.sleep(600)


def crash():
    os.kill(os.getpid(), signal.SIGSEGV)


def child():
    """A child that outlives its parent and keeps the pipe."""
    if os.fork() == 0:
        with open("child.pid", "w") as stream:
            stream.write(str(os.getpid()))
        keep = os.environ.get("FAKE_FEBIO_COUNT")
        if keep:
            with open(keep, "w") as stream:
                stream.write(str(os.getpid()))
        time.sleep(600)
        os._exit(0)


sys.exit(main(sys.argv[1:]))
