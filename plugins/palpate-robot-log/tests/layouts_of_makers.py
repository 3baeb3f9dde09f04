# ruff: noqa: E501 - a line of a layout is a line here
"""Files in the layouts of makers' programs, with the curve or the press that each of them holds.

Every text is written here after manuals and public files of the makers, with numbers of a known curve:
41 rows of 0.4 N/mm^1.5 up to 8 mm, or a linear stress of 60 kPa, or the press of ``known_presses``.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from io import BytesIO
from typing import NamedTuple

import numpy as np
import polars as pl
import pytest
from scipy.io import savemat

from palpate.domain import FloatArray

from .known_presses import press

DEPTH = 0.2 * np.arange(41)
FORCE = 0.4 * DEPTH**1.5
SECONDS = DEPTH / 0.5
STRAIN = np.linspace(0.0, 0.2, 41)
STRESS_KPA = 60.0 * STRAIN


class Layout(NamedTuple):
    """Bytes of a file, its ending, and what is in it: ``press``, ``curve``, a mode of a test, or a question."""

    content: bytes
    ending: str
    holds: str


def rows(*columns: FloatArray, between: str = ",", form: str = "{:.6g}", decimal: str = ".") -> list[str]:
    return [
        between.join(form.format(value).replace(".", decimal) for value in row)
        for row in np.column_stack(columns).tolist()
    ]


def made(
    lines: Sequence[str], holds: str, ending: str = "csv", encoding: str = "utf-8", end: str = "\r\n"
) -> Layout:
    return Layout((end.join(lines) + end).encode(encoding), ending, holds)


def hdf5(arrays: Mapping[str, tuple[FloatArray, str]], holds: str) -> Layout:
    """HDF5 with units in bytes, as programs in C write them."""
    h5py, content = pytest.importorskip("h5py"), BytesIO()
    with h5py.File(content, "w") as file:
        for name, (values, unit) in arrays.items():
            file.create_dataset(name, data=values).attrs["units"] = np.bytes_(unit)
    return Layout(content.getvalue(), "h5", holds)


def saved(ending: str, write: Callable[[BytesIO], object]) -> Layout:
    """Curve in a binary file, by the function that writes it."""
    content = BytesIO()
    write(content)
    return Layout(content.getvalue(), ending, "curve")


def _labelled(content: BytesIO) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(content, "w") as file:
        table = file.create_dataset("run/table", data=np.column_stack([SECONDS, 1e3 * DEPTH, 1e3 * FORCE]))
        table.attrs["columns"], table.attrs["units"] = ["Time", "Depth", "Force"], "s, um, mN"


def _with_units(content: BytesIO) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(content, "w") as file:
        for name, values, unit in (("depth", 1e3 * DEPTH, "um"), ("force", 1e3 * FORCE, "mN")):
            file[f"{name}/data"], file[f"{name}/unit"] = values, unit


def _structures(content: BytesIO) -> None:
    samples = zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)
    pl.DataFrame({"probe": [{"depth_um": a, "load": {"force_mN": b}} for a, b in samples]}).write_parquet(
        content
    )


MATLAB: Mapping[str, dict[str, object]] = {
    "MATLAB, data and unit": {"test": {"depth": {"data": 1e3 * DEPTH, "unit": "um"}, "force": {"data": 1e3 * FORCE, "unit": "mN"}}},
    "MATLAB, names and units": {
        "data": np.column_stack([1e3 * DEPTH, 1e3 * FORCE]),
        "names": np.array(["Depth", "Force"], dtype=object), "units": np.array(["um", "mN"], dtype=object)},
    "MATLAB, importdata": {"A": {"data": np.column_stack([DEPTH, 1e3 * FORCE]), "colheaders": np.array(["Depth (mm)", "Force (mN)"], dtype=object)}},
    "MATLAB, channels of dSPACE": {
        "Y": np.array([[(DEPTH, "Depth", "mm")], [(1e3 * FORCE, "Force", "mN")]], dtype=[("Data", object), ("Name", object), ("Unit", object)])},
}  # fmt: skip


def _curves() -> Mapping[str, Callable[[], Layout]]:
    quoted = '"{:.4f}"'
    return {
        "Instron Bluehill Universal": lambda: made(
            ["Results Table 1", ",Maximum Force,Extension at Maximum", ",(N),(mm)", "1,9.0510,8.0000", "",
             "Raw Data", "Time,Extension,Load", "(s),(mm),(N)", *rows(SECONDS, DEPTH, FORCE, form=quoted)], "curve"),
        "Instron Bluehill 3": lambda: made(
            ['"Specimen 1 to 1"', '"","Start Date","14.03.2030"', "", '"Time (sec)","Compressive extension (mm)","Compressive load (N)"',
             *rows(SECONDS, DEPTH, FORCE, form=quoted)], "curve"),
        "Instron, kilonewtons": lambda: made(['"Time (sec)","Displacement (mm)","Force (kN)"', *rows(SECONDS, DEPTH, FORCE / 1e3, form='"{:.7f}"')], "curve"),
        "Zwick testXpert II": lambda: made(
            ["Prüfprotokoll", "Kunde\tLabor", "", "Prüfzeit\tStandardweg\tStandardkraft", "s\tmm\tN",
             *rows(SECONDS, DEPTH, FORCE, between="\t", decimal=",")], "curve", "txt", "cp1252"),
        "Zwick testXpert III": lambda: made(
            ['"Specimen 1"', '"Test time";"Standard travel";"Standard force"', '"s";"mm";"N"',
             *rows(SECONDS, DEPTH, FORCE, between=";")], "curve"),
        "Zwick, strain": lambda: made(["Dehnung;Spannung", "%;MPa", *rows(100.0 * STRAIN, STRESS_KPA / 1e3, between=";", decimal=",")], "uniaxial", encoding="cp1252"),
        "tension with the pressure of a clamp": lambda: made(["Dehnung [%];Spannung [MPa];Druck [bar]", *rows(100.0 * STRAIN, STRESS_KPA / 1e3, 6.0 + 0.0 * STRAIN, between=";")], "uniaxial"),
        "tension by a machine that compresses too": lambda: made(["Time (s),Compressive extension (mm),Tensile strain (mm/mm),Tensile stress (MPa)", *rows(SECONDS, -DEPTH, STRAIN, STRESS_KPA / 1e3)], "uniaxial"),
        "tension that makes a specimen thinner": lambda: made(["strain,stress (MPa),height (mm)", *rows(STRAIN, STRESS_KPA / 1e3, 2.0 - 0.5 * STRAIN)], "uniaxial"),
        "a load cell for compression": lambda: made(["Strain,Stress (kPa),Compression load cell (N)", *rows(STRAIN, STRESS_KPA, STRESS_KPA)], "uniaxial"),
        "words in most columns": lambda: made(
            ["time_s,depth_mm,force_N,state,mode,operator,phase,tool",
             *(f"{row},running,auto,lab,loading,sphere" for row in rows(np.linspace(0.0, 16.0, 641), np.linspace(0.0, 8.0, 641), 0.4 * np.linspace(0.0, 8.0, 641) ** 1.5))], "curve"),
        "nanometres in capitals": lambda: made(["DEPTH_NM,FORCE_NN", *rows(DEPTH, FORCE)], "question"),
        "Shimadzu Trapezium X": lambda: made(
            ['"試験名","圧縮"', '"1 _ 1","",""', '"時間","試験力","ストローク"', '"秒","N","mm"',
             *rows(SECONDS, FORCE, DEPTH)], "curve", encoding="shift_jis"),
        "Shimadzu Trapezium, English": lambda: made(
            ['"Name","1 _ 1",""', '"Time","Force","Stroke"', '"sec","N","mm"', *rows(SECONDS, FORCE, DEPTH)], "curve"),
        "Shimadzu Trapezium 2": lambda: made(
            ["Key Word,,Product Name,", "Test Type,Compression,Speed,30 mm/min", "Time(sec),Stroke(mm),Force(N)",
             *rows(SECONDS, DEPTH, FORCE)], "curve"),
        "Mach-1": lambda: made(
            ["<Mach-1 File>", "<INFO>", "Time:\t12:00:01", "Date:\t3/14/2030", "<END INFO>", "<DATA>",
             "Time, s\tPosition (z), mm\tFz, N", *rows(SECONDS, DEPTH, FORCE, between="\t"), "<END DATA>"], "curve", "txt"),
        "TA.XT Exponent": lambda: made(
            ["Force\tDistance\tTime", "g\tmm\tsec", *rows(FORCE / 9.80665e-3, DEPTH, SECONDS, between="\t")], "curve", "tab"),
        "TA.XT Connect": lambda: made(
            ["Test 1,,", "Force (kg),Distance (mm),Time (sec)", *rows(FORCE / 9.80665, DEPTH, SECONDS)], "curve"),
        "MTS TestSuite": lambda: made(
            ["MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A", "Data Header:\tSpecimen 3", "Data Acquisition: Timed\t\tTime:\t1.5\tSec", "",
             "Axial Displacement\tAxial Force\tRunning Time", "mm\tN\tSec", *rows(DEPTH, FORCE, SECONDS, between="\t")], "curve", "txt"),
        "MTS TestWorks": lambda: made(
            ["Crosshead (mm) \tLoad (N) \tTime (sec) ", *rows(DEPTH, FORCE, SECONDS, between="\t")], "curve", "txt"),
        "CellScale UniVert": lambda: made(
            ["Cycle,Time_S,Size_um,Displacement_um,Force_mN",
             *[f"1-Compress,{line}" for line in rows(SECONDS, 12000.0 - 1e3 * DEPTH, 1e3 * DEPTH, 1e3 * FORCE)]], "curve"),
        "Bose ElectroForce WinTest": lambda: made(
            ["WinTest Data", "Scan Points\t41", "Elapsed Time\tDisp\tLoad", "Sec\tmm\tN",
             *rows(SECONDS, DEPTH, FORCE, between="\t")], "curve", "txt"),
        "TA ElectroForce": lambda: made(
            ['"Points","Elapsed Time ","Disp ","Load "', '"","(Sec) ","(mm) ","(N) "',
             *[f"{i},{line}" for i, line in enumerate(rows(SECONDS, DEPTH, FORCE), 1)]], "curve"),
        "LabVIEW lvm": lambda: made(
            ["LabVIEW Measurement", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t.", "***End_of_Header***\t", "",
             "Channels\t2\t\t", "Y_Unit_Label\tMillimeters\tNewtons\t", "X0\t0.0\t0.0\t", "Delta_X\t0.4\t0.4\t",
             "***End_of_Header***\t\t\t", "X_Value\tPosition\tForce\tComment",
             *[f"{line}\t" for line in rows(SECONDS, DEPTH, FORCE, between="\t")]], "curve", "lvm"),
        "LabVIEW lvm without times": lambda: made(
            ["LabVIEW Measurement", "Separator\tTab", "X_Columns\tNo", "***End_of_Header***", "", "Channels\t2\t\t", "Samples\t41\t41\t",
             "Y_Unit_Label\tmm\tN\t", "X_Dimension\tTime\tTime\t", "X0\t0.0E+0\t0.0E+0\t", "Delta_X\t0.400000\t0.400000\t",
             "***End_of_Header***\t\t\t", "X_Value\tPosition\tForce\tComment",
             *[f"\t{line}" for line in rows(DEPTH, FORCE, between="\t")]], "curve", "lvm"),
        "Zwick, specimens side by side": lambda: made(
            ["Probe 1;;Probe 2;", "Standardweg;Standardkraft;Standardweg;Standardkraft", "mm;N;mm;N",
             *rows(DEPTH, FORCE, DEPTH, 1.2 * FORCE, between=";", decimal=",")], "curve"),
        "Mach-1, two functions": lambda: made(
            ["<Mach-1 File>", "<Find Contact>", "<DATA>", "Time, s\tPosition (z), mm\tFz, N", *rows(SECONDS[:9], -DEPTH[8::-1], 0.0 * SECONDS[:9], between="\t"),
             "<END DATA>", "<Stress Relaxation>", "<DATA>", "Time, s\tPosition (z), mm\tFz, N", *rows(SECONDS, DEPTH, FORCE, between="\t"), "<END DATA>"], "curve", "txt"),
        "mean and deviation": lambda: made(
            ["Depth (mm),Force mean (N),Force SD (N)", *rows(DEPTH, FORCE, 0.05 * FORCE)], "curve"),
        "JSON, an object a line": lambda: made(
            [json.dumps({"depth_mm": d, "load": {"force_N": f}}) for d, f in zip(DEPTH.tolist(), FORCE.tolist(), strict=True)], "curve", "jsonl"),
        "JSON of lists": lambda: Layout(json.dumps({"depth_mm": DEPTH.tolist(), "force_N": FORCE.tolist()}).encode(), "json", "curve"),
        "gamma and tau": lambda: made(["gamma (-),tau (kPa)", *rows(STRAIN, STRESS_KPA)], "simple_shear"),
        "biaxial machine": lambda: made(
            ["Time_S,XDisplacement_um,YDisplacement_um,XForce_mN,YForce_mN", *rows(SECONDS, DEPTH, DEPTH, FORCE, FORCE)], "question"),
        "Mark-10 MESUR": lambda: made(
            ["Reading,Load [N],Travel [mm],Time [sec]", *[f"{i},{line}" for i, line in enumerate(rows(FORCE, DEPTH, SECONDS), 1)]], "curve"),
        "Admet MTESTQuattro": lambda: made(
            ["Position (in),Load (lbF),Time (sec)", *rows(DEPTH / 25.4, FORCE / 4.4482216152605, SECONDS)], "curve"),
        "Brookfield CT3": lambda: made(
            ["Time (s);Distance (mm);Load (g)", *rows(SECONDS, DEPTH, FORCE / 9.80665e-3, between=";")], "curve"),
        "Lloyd NEXYGEN": lambda: made(
            ["Load (N)\tMachine Extension (mm)", *rows(FORCE, DEPTH, between="\t")], "curve", "txt"),
        "Optics11 Piuma": lambda: made(
            ["Date\t14/03/2030", "Tip radius (um)\t50.0", "k (N/m)\t0.5", "", "Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)",
             *rows(SECONDS, FORCE, 1e3 * DEPTH, 2.0 * FORCE, 1e3 * DEPTH + 2.0 * FORCE, between="\t")], "micro", "txt"),
        "Chinese machine": lambda: made(
            ["时间(s),位移(mm),力(N)", *rows(SECONDS, DEPTH, FORCE)], "curve", encoding="gb18030"),
        "Chinese machine, words for units": lambda: made(
            ["时间,位移,试验力", "秒,毫米,牛顿", *rows(SECONDS, DEPTH, FORCE)], "curve", encoding="gb18030"),
        "French machine": lambda: made(
            ["Temps (s);Déplacement (mm);Effort (N)", *rows(SECONDS, DEPTH, FORCE, between=";", decimal=",")], "curve", encoding="latin-1"),
        "Italian machine": lambda: made(
            ["Tempo [s];Spostamento [mm];Carico [N]", *rows(SECONDS, DEPTH, FORCE, between=";", decimal=",")], "curve"),
        "MATLAB timetable": lambda: made(
            ["Time,Depth_mm,Force_N", *[f"{t:g} sec,{d:g},{f:g}" for t, d, f in zip(SECONDS, DEPTH, FORCE, strict=True)]], "curve"),
        "GOM Correlate": lambda: made(
            ["Stage;Strain (Eng) [%];Stress (Eng) [MPa]", *[f"{i};{line}" for i, line in enumerate(rows(100.0 * STRAIN, STRESS_KPA / 1e3, between=";"))]], "uniaxial"),
        "TRIOS rheometer": lambda: made(
            ["Filename\tgel.tri", "[step]", "Shear strain\tShear stress", "%\tPa", *rows(100.0 * STRAIN, 1e3 * STRESS_KPA, between="\t")], "simple_shear", "txt"),
        "Compression plates": lambda: made(
            ["Compressive strain (mm/mm),Compressive stress (kPa)", *rows(STRAIN, STRESS_KPA)], "compression"),
        "strain gauge in microstrain": lambda: made(
            ["Time,Strain,Stress", "(s),(µε),(kPa)", *rows(SECONDS, 1e6 * STRAIN, STRESS_KPA)], "uniaxial"),
        "extensometer in mm/m": lambda: made(
            ["Dehnung (mm/m);Spannung (N/mm²)", *rows(1e3 * STRAIN, STRESS_KPA / 1e3, between=";", decimal=",")], "uniaxial"),
        "Greek letters": lambda: made(["λ,σ (kPa)", *rows(1.0 + STRAIN, STRESS_KPA)], "uniaxial"),
        "Russian machine": lambda: made(
            ["Время (с);Перемещение (мм);Нагрузка (Н)", *rows(SECONDS, DEPTH, FORCE, between=";", decimal=",")], "curve", encoding="cp1251"),
        "Korean machine": lambda: made(["시간(s),변위(mm),하중(N)", *rows(SECONDS, DEPTH, FORCE)], "curve"),
        "Polish machine": lambda: made(
            ["Czas [s];Przemieszczenie [mm];Siła [N]", *rows(SECONDS, DEPTH, FORCE, between=";", decimal=","), "Maksimum;8,00;9,05"], "curve"),
        "Spanish words for units": lambda: made(
            ["Desplazamiento;Carga", "milímetros;kilogramos-fuerza", *rows(DEPTH, FORCE / 9.80665, between=";", decimal=",", form="{:.9g}")], "curve"),
        "Polish letters": lambda: made(
            ["Właściwości próbki;seg9", "", "Czas;Przemieszczenie;Obciążenie", "(s);(mm);(kN)",
             *rows(SECONDS, DEPTH, 1e-3 * FORCE, between=";", decimal=",", form="{:.9g}")], "curve", encoding="cp1250"),
        "names on each page": lambda: made(
            ["Depth (mm),Force (N)", *rows(DEPTH[:20], FORCE[:20]), "Page 2", "Depth (mm),Force (N)", *rows(DEPTH[20:], FORCE[20:])], "curve"),
        "columns of fixed width": lambda: made(
            ["DEPTH      FORCE", "MM         N", *[f"{d:<10.4f} {f:<10.4f}" for d, f in zip(DEPTH, FORCE, strict=True)]], "curve", "prn"),
        "rheometer's gap": lambda: made(["Gap (mm),Normal force (N)", *rows(20.0 - DEPTH, FORCE)], "curve"),
        "specimen by strain and force": lambda: made(["Engineering strain (%),Load (N)", *rows(100.0 * STRAIN, FORCE)], "question"),
        "force over time alone": lambda: made(["Time (s),Force (N)", *rows(SECONDS, FORCE)], "question"),
        "turn in German degrees": lambda: made(["Winkel (grad),Moment (Nmm)", *rows(DEPTH, FORCE)], "question"),
        "marks between thousands": lambda: made(
            ['"Travel (um)","Load (mN)"', *[f'"{d:,.1f}","{f:,.2f}"' for d, f in zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)]], "curve"),
        "numbers alone": lambda: made([*rows(DEPTH, FORCE)], "question"),
        "two columns without names": lambda: made(["a,b", *rows(DEPTH, FORCE)], "question"),
        "stress by a letter": lambda: made(["lambda_1 [-],P11 [kPa]", *rows(1.0 + STRAIN, STRESS_KPA)], "question"),
        "Arduino and HX711": lambda: made(
            ["millis,steps,weight_g", *rows(1e3 * SECONDS, 200.0 * DEPTH, FORCE / 9.80665e-3)], "question"),
        "strain gauge in volts": lambda: made(
            ["Time (s),Position (mm),Load cell (V)", *rows(SECONDS, DEPTH, 0.1 * FORCE)], "question"),
        "specimen by force alone": lambda: made(
            ["Time (s),Tensile extension (mm),Load (N)", *rows(SECONDS, DEPTH, FORCE)], "question"),
        "stress of an unknown measure": lambda: made(
            ["Almansi strain,Stress (kPa)", *rows(STRAIN, STRESS_KPA)], "question"),
        "R with row names": lambda: made(
            ['"time" "depth_mm" "force_N"', *[f'"{i}" {line}' for i, line in enumerate(rows(SECONDS, DEPTH, FORCE, between=" "), 1)]], "curve", "txt"),
        "R with dots for brackets": lambda: made(
            ['"","Time..s.","Depth..um.","Force..mN."', *[f'"{i}",{line}' for i, line in enumerate(rows(SECONDS, 1e3 * DEPTH, 1e3 * FORCE), 1)]], "curve"),
        "Origin with remarks": lambda: made(
            ["Displacement\tForce", "mm\tN", "Sample 1\tSample 1", *rows(DEPTH, FORCE, between="\t")], "curve", "dat"),
        "target and actual depth": lambda: made(
            ["step,target_mm,actual_mm,force_N", *[f"{i},{line}" for i, line in enumerate(rows(1.01 * DEPTH, DEPTH, FORCE))]], "curve"),
        "rheometer that turns": lambda: made(
            ["Time (s),Torque (µN.m),Angular displacement (rad)", *rows(SECONDS, 1e3 * FORCE, np.radians(DEPTH), form="{:.12g}")], "torque"),
        "first Piola-Kirchhoff stress": lambda: made(["Stretch ratio (mm/mm),PK1 (kPa)", *rows(1.0 + STRAIN, STRESS_KPA)], "uniaxial"),
        "units of names in one word": lambda: made(["depthMm,forceMilliN", *rows(DEPTH, 1e3 * FORCE)], "curve"),
        "units before names": lambda: made(["mm depth,mN force", *rows(DEPTH, 1e3 * FORCE)], "curve"),
        "units after hyphens": lambda: made(["depth-um,force-mN", *rows(1e3 * DEPTH, 1e3 * FORCE)], "curve"),
        "cycles that grow": lambda: made(
            ["Depth (mm),Force (N)", *rows(*([np.concatenate([0.5 * of, 0.5 * of[-2::-1], of[1:], of[-2::-1]]) for of in (DEPTH, FORCE)]))], "curve"),
        "a unit that its capital leaves open": lambda: made(["depthUm,forceUN", *rows(1e3 * DEPTH, 1e6 * FORCE)], "question"),
        "commas between thousands": lambda: made(
            ["Travel (um);Force (mN)", *[f"{d:,.0f};{f:,.0f}" for d, f in zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)]], "refused"),
        "blanks between thousands": lambda: made(
            ["Travel (um);Force (mN)", *[f"{d:,.0f};{f:,.0f}".replace(",", " ") for d, f in zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)]], "curve"),
        "force in two units": lambda: made(
            ["Crosshead (in),Crosshead (mm),Load (lbf),Load (N)", *[f"{d / 25.4:.4f},{d:.6f},{f / 4.4482216:.3f},{f:.5f}" for d, f in zip(DEPTH, FORCE, strict=True)]], "curve"),
        "two sensors in two units": lambda: made(
            ["Crosshead (mm),Load (lbf),Load (N)", *rows(DEPTH, FORCE, FORCE)], "question"),
        "two values in a cell": lambda: made(
            ["Depth (mm);Force (mN)", *[f"{d:.4f};{100 + k} {300 + f:.0f}" for k, (d, f) in enumerate(zip(DEPTH, FORCE, strict=True))]], "question"),
        "two decimal values in a cell": lambda: made(
            ["Depth (mm);Force (mN)", *[f"{d:.4f};{100 + k} {300 + f:.1f}" for k, (d, f) in enumerate(zip(DEPTH, FORCE, strict=True))]], "question"),
        "apostrophes between thousands": lambda: made(
            ["Travel (um);Force (mN)", *[f"{d:,.0f};{f:,.1f}".replace(",", "'") for d, f in zip((1e3 * DEPTH).tolist(), (1e3 * FORCE).tolist(), strict=True)]], "curve"),
        "creep": lambda: made(["Time (s),Strain (%),Stress (Pa)", *rows(SECONDS, 100.0 * STRAIN, 0.0 * STRAIN + 100.0)], "question"),
        "newest row first": lambda: made(["Depth (mm),Force (N)", *rows(DEPTH[::-1], FORCE[::-1])], "question"),
        "stress of an indentation": lambda: made(["Indentation strain,Indentation stress (kPa)", *rows(STRAIN, STRESS_KPA)], "question"),
        "short names of measures": lambda: made(["eps_eng [-],sigma_eng [kPa]", *rows(STRAIN, STRESS_KPA)], "uniaxial"),
        "shear of a plate": lambda: made(["Shear displacement (mm),Shear force (N),Thickness (mm)", *rows(DEPTH, FORCE, 0.0 * DEPTH + 10.0)], "question"),
        "percent that R has no letter for": lambda: made(["Strain....,Stress..kPa.", *rows(40.0 * STRAIN, STRESS_KPA)], "question"),
        "creep from zero": lambda: made(
            ["Time (s),Strain,Stress (kPa)", "0,0,0", *rows(1.0 + SECONDS, 0.1 + STRAIN, 0.0 * STRAIN + 10.0)], "question"),
        "samples by number": lambda: made(["Depth (mm),sample1,sample2,sample3", *rows(DEPTH, FORCE, 1.1 * FORCE, 1.2 * FORCE)], "question"),
        "a sample by its letter": lambda: made(["depth_mm,sampleN,caseN", *rows(DEPTH, FORCE, 1.1 * FORCE)], "question"),
        "two axes without a mode": lambda: made(["lambda_1,lambda_2,P11 (kPa),P22 (kPa)", *rows(1.0 + STRAIN, 1.0 + STRAIN, STRESS_KPA, STRESS_KPA)], "question"),
        "cantilever": lambda: made(["z (nm),deflection (nm),force (nN)", *rows(1e6 * DEPTH, 1e3 * FORCE, 1e9 * FORCE)], "question"),
        "force in newtons": lambda: made(["Depth in mm,Force in N", *rows(DEPTH, FORCE)], "curve"),
        "counts in hexadecimal": lambda: made(
            ["time_ms,enc_z,enc_f", *(f"{k},0x{int(2e4 + 1e3 * d):04X},0x{int(8e3 + 5e2 * f):04X}" for k, d, f in zip(range(DEPTH.size), DEPTH, FORCE, strict=True))], "question"),
        "counts of four hexadecimal digits": lambda: made(
            ["tick,enc,adc", *(f"{k:04X},{int(2e4 + 1e3 * d):04X},{int(8e3 + 5e2 * f):04X}" for k, d, f in zip(range(DEPTH.size), DEPTH, FORCE, strict=True))], "refused"),
        "names on two lines": lambda: made(
            ['"Time\n(s)","Depth\n(mm)","Force\n(mN)"', *rows(SECONDS, DEPTH, 1e3 * FORCE)], "curve"),
        "preamble of 450 lines": lambda: made(
            [*(f"Parameter {i}: value {i}" for i in range(450)), "Time (s)\tDepth (mm)\tForce (N)", *rows(SECONDS, DEPTH, FORCE, between="\t")], "curve", "txt"),
        "full-width brackets": lambda: made(["时间（s）,位移（mm）,力（mN）", *rows(SECONDS, DEPTH, 1e3 * FORCE)], "curve"),
        "names and units in capitals": lambda: made(["DEPTH_UM,LOAD_KG", *rows(1e3 * DEPTH, FORCE / 9.80665, form="{:.9g}")], "curve"),
        "a unit in capitals that leaves it open": lambda: made(["DEPTH_UM,FORCE_MN", *rows(1e3 * DEPTH, 1e3 * FORCE)], "question"),
        "FemtoTools": lambda: made(
            ["Displacement [um]\tTime [s]\tPos X [um]\tPos Y [um]\tPos Z [um]\tForce A [uN]\tForce B [uN]",
             *rows(1e3 * DEPTH, SECONDS, 0.0 * DEPTH, 0.0 * DEPTH, 1e3 * DEPTH, 1e6 * FORCE, 0.0 * FORCE, between="\t")], "question", "txt"),
        "points between thousands of a machine": lambda: made(
            ["Zeit [s];Weg [µm];Kraft [mN]", *[f"{t:,.1f};{d:,.1f};{f:,.1f}".translate(str.maketrans(",.", ".,"))
                                              for t, d, f in np.column_stack([SECONDS, 1e3 * DEPTH, 1e3 * FORCE]).tolist()]], "curve"),
        "HDF5 with units of bytes": lambda: hdf5({"displacement": (1e3 * DEPTH, "um"), "force": (1e3 * FORCE, "mN")}, "curve"),
        "rheometer that closes its gap": lambda: made(
            ["[step]", "Step time\tGap\tAxial force\tStress\tStrain", "s\tmm\tN\tPa\t%",
             *rows(SECONDS, 20.0 - 20.0 * STRAIN, FORCE, 1e3 * STRESS_KPA, 100.0 * STRAIN, between="\t")], "compression", "txt"),
        "plates named by their load": lambda: made(
            ["Compressive load (N),Strain,Stress (kPa)", *rows(FORCE, STRAIN, STRESS_KPA)], "compression"),
        "unit in capitals in brackets": lambda: made(["DEPTH (UM),LOAD (N)", *rows(1e3 * DEPTH, FORCE)], "curve"),
        "tables side by side of two lengths": lambda: made(
            ["Raw,,Annealed,", "Travel,Force,Travel,Force", "mm,N,mm,N",
             *[f"{line},{line}" for line in rows(DEPTH, FORCE)], *[f",,{line}" for line in rows(8.1 + DEPTH, FORCE)]], "curve"),
        "tension by its preamble": lambda: made(
            ['"Type of Test","Tensile - Round"', "", "Time,Extension,Load", "(s),(mm),(N)", *rows(SECONDS, DEPTH, FORCE)], "question"),
        "specimen by its sizes": lambda: made(
            ['"Épaisseur éprouvette",1,"mm"', '"Largeur éprouvette",5.96,"mm"', '"L0 - course standard",25,"mm"', '"Opérateur",""',
             '"Temps","Traverse absolue","Force standard","Course standard"', '"s","mm","N","mm"', *rows(SECONDS, 25.0 * STRAIN - 794.864, 5.96e-3 * STRESS_KPA, 25.0 * STRAIN)],
            "uniaxial", "txt", "latin-1"),
        "absolute and relative way": lambda: made(
            ["Time,Crosshead absolute,Standard force,Standard travel", "s,mm,N,mm", *rows(SECONDS, DEPTH - 755.377, FORCE, DEPTH)], "curve", "txt"),
        "bending by its preamble": lambda: made(
            ['"Maximum Load : Flexure extension at Maximum Load","1.5",mm', "", "Time,Extension,Load", "(s),(mm),(N)", *rows(SECONDS, DEPTH, FORCE)], "question"),
        "compression by its preamble": lambda: made(
            ['"Test","Compression"', '"Not used","Tensile"', "Time,Extension,Load", "(s),(mm),(N)", *rows(SECONDS, DEPTH, FORCE)], "curve"),
        "press on an arm by its preamble": lambda: made(
            ["# Forearm, elbow flexion 30 deg, skin under tension", "Depth (mm),Force (N)", *rows(DEPTH, FORCE)], "curve"),
        "a plural before the unit": lambda: made(["Depth (mm),Load cell(s) force N", *rows(DEPTH, FORCE)], "curve"),
        "bending": lambda: made(["Flexure strain (mm/mm),Flexure stress (kPa)", *rows(STRAIN, STRESS_KPA)], "question"),
        "amplitudes of an oscillation": lambda: made(["Shear Strain (%),Shear Stress (kPa),Storage Modulus (kPa)", *rows(100.0 * STRAIN, STRESS_KPA, STRESS_KPA)], "question"),
        "moduli over frequency": lambda: made(["Frequency (Hz),Storage modulus (kPa),Loss modulus (kPa)", *rows(1.0 + SECONDS, STRESS_KPA, STRESS_KPA)], "question"),
        "inflation": lambda: made(["Pressure (mmHg),Diameter (mm)", *rows(STRESS_KPA, 10.0 + DEPTH)], "question"),
        "flow": lambda: made(["Shear Rate (1/s),Shear Stress (kPa)", *rows(STRAIN, STRESS_KPA)], "question"),
        "sensor alone": lambda: made(
            ["Time (s),Force X (N),Force Y (N),Force Z (N),Torque X (Nm),Torque Y (Nm),Torque Z (Nm)", *rows(SECONDS, *([FORCE] * 6))], "question"),
        "forces of a sensor alone": lambda: made(["Time (s),Force_X,Force_Y,Force_Z", *rows(SECONDS, FORCE, FORCE, FORCE)], "question"),
        "metres without a word": lambda: made(["Displacement,Force", *rows(1e-3 * DEPTH, FORCE)], "question"),
        "inches by their mark": lambda: made(['Depth ("),Force (lbf)', *rows(DEPTH / 25.4, FORCE / 4.4482216152605, form="{:.9g}")], "curve"),
        "inches by their mark in quotes": lambda: made(['"Depth ("")","Force (lbf)"', *rows(DEPTH / 25.4, FORCE / 4.4482216152605, form="{:.9g}")], "curve"),
        "a remark on the sign": lambda: made(["Depth [um] (down positive),Force [mN] (compression negative)", *rows(1e3 * DEPTH, -1e3 * FORCE)], "curve"),
        "a word behind the unit": lambda: made(["Depth (um) measured,Force (mN) channel A", *rows(1e3 * DEPTH, 1e3 * FORCE)], "curve"),
        "HDF5 of named columns": lambda: saved("h5", _labelled),
        "HDF5 of data and unit": lambda: saved("h5", _with_units),
        "Parquet of structures": lambda: saved("parquet", _structures),
        **{name: partial(saved, "mat", partial(savemat, mdict=of)) for name, of in MATLAB.items()},
        "one name for a length and a strain": lambda: made(
            ["Zeit;Zugdehnung (Weg);Zugdehnung (Weg);Zugspannung", "(s);(mm);(mm/mm);(kPa)", *rows(SECONDS, 20.0 * STRAIN, STRAIN, STRESS_KPA, between=";", decimal=",")], "uniaxial"),
        "units above names": lambda: made(["s,um,mN", "time,depth,force", *rows(SECONDS, 1e3 * DEPTH, 1e3 * FORCE)], "curve"),
        "compression by a French preamble": lambda: made(["Essai de compression", "", "Déformation;Contrainte", "%;kPa", *rows(100.0 * STRAIN, STRESS_KPA, between=";", decimal=",")], "compression"),
        "shear by its preamble": lambda: made(["Test,Lap shear", "Overlap width (mm),10", "Displacement (mm),Force (N)", *rows(DEPTH, FORCE)], "question"),
        "specimen by stretch and force": lambda: made(["Stretch (-),Force (cN)", *rows(1.0 + STRAIN, FORCE)], "question"),
        "tension in cycles": lambda: made(
            ["Engineering strain,Engineering stress (kPa)", *rows(*([np.concatenate([of, less * of[-2::-1], of[1:], less * of[-2::-1]]) for of, less in ((STRAIN, 1.0), (STRESS_KPA, 0.9))]))], "uniaxial"),
        "tension and relaxation": lambda: made(["Strain (%),Stress (kPa)", *rows(100.0 * STRAIN, STRESS_KPA), *rows(20.0 + 1e-3 * np.sin(DEPTH), 12.0 - 0.5 * DEPTH)], "uniaxial"),
        "force and displacement along z": lambda: made(["Time (S),Xpos (um),ZForce (mN),ZDisplacement (um)", *rows(SECONDS, 0.0 * DEPTH, 1e3 * FORCE, 1e3 * DEPTH)], "curve"),
        "fatigue": lambda: made(["Cycle,Strain (%),Stress (kPa)", *rows(np.arange(41), 10.0 + 10.0 * STRAIN, 0.0 * STRAIN + 5.0)], "question"),
        "force in volts by its name": lambda: made(["depth_mm,force_V", *rows(DEPTH, 0.1 * FORCE)], "question"),
    }  # fmt: skip


def presses() -> Mapping[str, Callable[[], Layout]]:
    p = press(twist=True, retract=True)
    q, t = p.pose.as_quat(), p.time_s
    tip, m = p.tip_mm, 1e-3 * p.tip_mm
    f, moment = p.force_N, p.moment_Nm
    zyx = p.pose.as_euler("ZYX", degrees=True)
    rotvec, matrix = p.pose.as_rotvec(), p.pose.as_matrix()
    xyz = p.pose.as_euler("xyz", degrees=True)
    transform = np.zeros((t.size, 4, 4))
    transform[:, :3, :3], transform[:, :3, 3], transform[:, 3, 3] = matrix, m, 1.0
    base_f, base_m = p.pose.apply(f), p.pose.apply(moment)
    w_first = q[:, [3, 0, 1, 2]]
    digits = "{:.17g}"

    def named(
        names: str, *values: FloatArray, between: str = ",", head: Sequence[str] = (), **more: str
    ) -> Layout:
        lines = [*head, names, *rows(*values, between=between, form=digits)]
        return made(lines, "press", **more)

    return {
        "UR and OnRobot HEX": lambda: named(
            "t(s),X(m),Y(m),Z(m),RX(rad),RY(rad),RZ(rad),Fx(N),Fy(N),Fz(N),Tx(Nm),Ty(Nm),Tz(Nm)", t, m, rotvec, f, moment),
        "UR RTDE recorder": lambda: named(
            " ".join(["timestamp", *(f"actual_TCP_pose_{i}" for i in range(6)), *(f"actual_TCP_force_{i}" for i in range(6)),
                      *(f"target_TCP_pose_{i}" for i in range(6))]), t, m, rotvec, base_f, base_m, m, rotvec, between=" "),
        "Bota and ROS pose": lambda: named(
            "timestamp,position_x,position_y,position_z,orientation_x,orientation_y,orientation_z,orientation_w,"
            "force_x,force_y,force_z,torque_x,torque_y,torque_z", t, m, q, f, moment),
        "current pose of MoveIt": lambda: named(
            ",".join(["time", *(f"current_pose.position.{a}" for a in "xyz"), *(f"current_pose.orientation.{a}" for a in "xyzw"),
                      *(f"current_wrench.{part}.{a}" for part in ("force", "torque") for a in "xyz")]), t, m, q, f, moment),
        "KUKA iiwa recorder": lambda: named(
            "Time,X,Y,Z,A,B,C,Force_X,Force_Y,Force_Z,Torque_X,Torque_Y,Torque_Z", t, tip, zyx, f, moment),
        "KUKA FRI in radians": lambda: named(
            "time_ms X_mm Y_mm Z_mm A_rad B_rad C_rad Fx_N Fy_N Fz_N Mx_Nm My_Nm Mz_Nm", 1e3 * t, tip, np.radians(zyx), f, moment, between=" "),
        "Franka, vectors by index": lambda: named(
            ",".join(["time", *(f"O_T_EE[{i}]" for i in range(16)), *(f"O_F_ext_hat_K[{i}]" for i in range(6)),
                      *(f"tau_J[{i}]" for i in range(7))]),
            t, transform.transpose(0, 2, 1).reshape(-1, 16), -base_f, -base_m, np.tile(np.arange(7.0), (t.size, 1))),
        "ABB EGM": lambda: named(
            "Time[ms];X[mm];Y[mm];Z[mm];q1;q2;q3;q4;Fx[N];Fy[N];Fz[N];Mx[Nm];My[Nm];Mz[Nm]", 1e3 * t, tip, w_first, f, moment, between=";"),
        "PlotJuggler": lambda: named(
            "__time,/tcp/pose/position/x,/tcp/pose/position/y,/tcp/pose/position/z,/tcp/pose/orientation/x,/tcp/pose/orientation/y,"
            "/tcp/pose/orientation/z,/tcp/pose/orientation/w,/ft/wrench/force/x,/ft/wrench/force/y,/ft/wrench/force/z,"
            "/ft/wrench/torque/x,/ft/wrench/torque/y,/ft/wrench/torque/z", np.round(1.9e9 + t, 3), m, q, f, moment),
        "rostopic echo -p": lambda: named(
            "%time,field.pose.position.x,field.pose.position.y,field.pose.position.z,field.pose.orientation.x,field.pose.orientation.y,"
            "field.pose.orientation.z,field.pose.orientation.w,field.wrench.force.x,field.wrench.force.y,field.wrench.force.z,"
            "field.wrench.torque.x,field.wrench.torque.y,field.wrench.torque.z", np.round(1e9 * t), m, q, f, moment),
        "MATLAB timetable of vectors": lambda: Layout(
            ("\n".join(["Time,pos_1,pos_2,pos_3,quat_1,quat_2,quat_3,quat_4,F_1,F_2,F_3,M_1,M_2,M_3",
                        *[f"{a:g} sec,{line}" for a, line in zip(t, rows(m, w_first, f, moment, form=digits), strict=True)]]) + "\n").encode(),
            "csv", "press"),
        "Fanuc": lambda: named(
            "Time(sec),X(mm),Y(mm),Z(mm),W(deg),P(deg),R(deg),FX(N),FY(N),FZ(N),MX(Nm),MY(Nm),MZ(Nm)", t, tip, xyz, f, moment),
        "Staubli": lambda: named(
            "time(ms);x(mm);y(mm);z(mm);rx(deg);ry(deg);rz(deg);Fx(N);Fy(N);Fz(N);Mx(Nm);My(Nm);Mz(Nm)",
            1e3 * t, tip, p.pose.as_euler("XYZ", degrees=True), f, moment, between=";"),
        "Kinova Kortex": lambda: named(
            "time,tool_pose_x,tool_pose_y,tool_pose_z,tool_pose_theta_x,tool_pose_theta_y,tool_pose_theta_z,"
            "tool_external_wrench_force_x,tool_external_wrench_force_y,tool_external_wrench_force_z,"
            "tool_external_wrench_torque_x,tool_external_wrench_torque_y,tool_external_wrench_torque_z", t, m, xyz, f, moment),
        "xArm": lambda: named(
            "timestamp,x,y,z,roll,pitch,yaw,ft_ext_fx,ft_ext_fy,ft_ext_fz,ft_ext_tx,ft_ext_ty,ft_ext_tz", t, tip, xyz, f, moment),
        "rotation vector by its name": lambda: named(
            "t,pos_x,pos_y,pos_z,rotvec_x,rotvec_y,rotvec_z,fx,fy,fz,mx,my,mz", t, m, rotvec, f, moment),
        "Flexiv": lambda: named(
            ",".join(["time_s", *(f"tcp_pose_{i}" for i in range(7)), *(f"ext_wrench_in_tcp_{i}" for i in range(6))]), t, m, w_first, f, moment),
        "ATI in newton millimetres": lambda: named(
            "Time (s)\tPx (mm)\tPy (mm)\tPz (mm)\tq0\tqx\tqy\tqz\tFx (N)\tFy (N)\tFz (N)\tTx (N-mm)\tTy (N-mm)\tTz (N-mm)",
            t, tip, w_first, f, 1e3 * moment, between="\t", ending="tsv"),
        "Doosan": lambda: named(
            "time_s,posx_x_mm,posx_y_mm,posx_z_mm,posx_a_deg,posx_b_deg,posx_c_deg,tool_fx_N,tool_fy_N,tool_fz_N,tool_mx_Nm,tool_my_Nm,tool_mz_Nm",
            t, tip, p.pose.as_euler("ZYZ", degrees=True), f, moment),
        "Chinese robot": lambda: named(
            "时间(s),位置X(mm),位置Y(mm),位置Z(mm),四元数w,四元数x,四元数y,四元数z,力X(N),力Y(N),力Z(N),力矩X(N·m),力矩Y(N·m),力矩Z(N·m)", t, tip, w_first, f, moment),
        "JSON of robots": lambda: made(
            [json.dumps({"t": a, "pose": {"position_mm": b, "quaternion_wxyz": c}, "wrench": {"force": d, "torque": e}})
             for a, b, c, d, e in zip(*(each.tolist() for each in (t, tip, w_first, f, moment)), strict=True)], "press", "jsonl"),
        "JSON of short names": lambda: made(
            [json.dumps({"stamp": a, "tcp": {"p": b, "q": c}, "ft": {"f": d, "m": e}})
             for a, b, c, d, e in zip(*(each.tolist() for each in (t, m, q, f, moment)), strict=True)], "press", "jsonl"),
        "forces of the right hand": lambda: named(
            "t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,Fx_R,Fy_R,Fz_R,Mx_R,My_R,Mz_R", t, tip, q, f, moment),
        "force and moment by one word": lambda: named(
            ",".join(["Time", *(f"{of}_{axis}" for of in ("ToolVectorActual", "TCPForce") for axis in ["x", "y", "z", "rx", "ry", "rz"])]), t, m, rotvec, base_f, base_m),
        "UR with all that its recorder has": lambda: named(
            ",".join(["timestamp", *(f"{of}_{i}" for of in ("elbow_position", "actual_tool_accelerometer", "payload_cog") for i in range(3)),
                      *(f"actual_TCP_pose_{i}" for i in range(6)), *(f"actual_TCP_force_{i}" for i in range(6))]),
            t, 0.3 * m + 0.1, 9.8 + 0.1 * np.sin(tip), m, m, rotvec, base_f, base_m),
        "times of another time zone": lambda: made(
            ["stamp,x_mm,y_mm,z_mm,qx,qy,qz,qw,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm",
             *[f"2030-11-30T10:00:{a:06.3f}+09:00,{line}" for a, line in zip(t.tolist(), rows(tip, q, f, moment, form=digits), strict=True)]], "press"),
        "two arms": lambda: named(
            ",".join(["t", *(f"{arm}_{of}" for arm in ("left", "right") for of in ("x", "y", "z", "qx", "qy", "qz", "qw")), *(f"right_{of}" for of in ("fx", "fy", "fz", "tx", "ty", "tz"))]),
            t, 0.4 + 0.0 * m, np.tile(q[:1], (t.size, 1)), m, q, f, moment),
        "tracker without a wrench": lambda: named("Frame,Q0,Qx,Qy,Qz,Tx,Ty,Tz", np.arange(t.size), w_first, tip)._replace(holds="question"),
        "a wrist's joint": lambda: named(
            ",".join(["t_s", *(f"{of}{axis}" for of in ("column.pos.", "column.quat.") for axis in "xyzw"[: 3 + ("q" in of)]),
                      *(f"wrist_joint_{of}_{axis}" for of in ("force", "torque") for axis in "xyz")]), t, m, q, f, moment),
        "an elbow next to the tool": lambda: named(
            ",".join(["t_s", *(f"elbow_position_{axis} [m]" for axis in "xyz"), "x,y,z,qx,qy,qz,qw,fx,fy,fz,mx,my,mz"]),
            t, 0.3 * m + 0.1, m, q, f, moment),
        "KUKA's letters of the moment": lambda: named(
            "time_s,x,y,z,a,b,c,ft_x,ft_y,ft_z,ft_a,ft_b,ft_c", t, tip, zyx, f, moment[:, ::-1]),
        "HDF5 of a trial": lambda: hdf5(
            {f"trial_1/{name}": of for name, of in {
                "time": (1e3 * t, "ms"), "tcp/position": (tip, "mm"), "tcp/quaternion": (q, "-"), "wrench/force": (1e3 * f, "mN"), "wrench/torque": (1e3 * moment, "mN*m")
            }.items()}, "press"),
        "robot without a time": lambda: named(
            "x_mm,y_mm,z_mm,qx,qy,qz,qw,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm", tip, q, f, moment)._replace(holds="question"),
        "machine in revolutions": lambda: named(
            "Elapsed Time (sec),Extension (in),Load (lbf),Rotation (rev),Torque (lbf-in)", t, (203.0 - tip[:, 2:]) / 25.4, -f[:, 2:] / 4.4482216152605,
            np.unwrap(zyx[:, :1], axis=0, period=360.0) / 360.0, moment[:, 2:] / 0.1129848290276),
        "UR script's poses": lambda: made(
            ["time;pose;Fx;Fy;Fz;Mx;My;Mz", *[f"{a};p[{place}];{wrench}" for a, place, wrench in zip(
                t.tolist(), rows(m, rotvec, between=", ", form=digits), rows(f, moment, between=";", form=digits), strict=True)]], "press"),
        "ABB robtargets": lambda: made(
            ["t;robtarget;wrench", *[f"{a};[[{b}],[{c}]];[{d}]" for a, b, c, d in zip(
                t.tolist(), *(rows(*each, form=digits) for each in ((tip,), (w_first,), (f, moment))), strict=True)]], "press"),
        "names in groups": lambda: made(
            [",pose,pose,pose,pose,pose,pose,pose,force,,,torque,,", "time,x,y,z,qx,qy,qz,qw,x,y,z,x,y,z", *rows(t, m, q, f, moment, form=digits)], "press"),
        "moment before force, by numbers": lambda: named(
            ",".join(["t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw", *(f"wrench_{i}" for i in range(6))]), t, tip, q, moment, f),
        "sensor in volts": lambda: named(
            "t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,Fx [V],Fy [V],Fz [V],Mx [V],My [V],Mz [V]", t, tip, q, f, moment)._replace(holds="question"),
        "sensor in counts": lambda: named(
            "t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw,Fx (counts),Fy (counts),Fz (counts),Tx (counts),Ty (counts),Tz (counts)",
            t, tip, q, 1e5 * f, 1e5 * moment)._replace(holds="question"),
        "machine that presses and turns": lambda: named(
            "Time (s),Crosshead (mm),Load (N),Rotation (deg),Torque (N·mm)",
            t, 203.0 - tip[:, 2:], -f[:, 2:], np.unwrap(zyx[:, :1], axis=0, period=360.0), 1e3 * moment[:, 2:]),
        "OpenSim": lambda: named("\t".join(["time", *(f"force_{of}{axis}" for of in "vp" for axis in "xyz"), *(f"moment_{axis}" for axis in "xyz"), *(f"tool_{of}{axis}" for of in "tr" for axis in "xyz")]), t, f, 0.1 * m, moment, m, xyz, between="\t", head=["press", "version=1", "inDegrees=yes", "endheader"], ending="mot"),
        "days of MATLAB": lambda: named("datenum,x_mm,y_mm,z_mm,qx,qy,qz,qw,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm", 739000.5 + t / 86400.0, tip, q, f, moment),
        "units in one word": lambda: named("t_ms,Disp_in,Load_cN,Angle_mrad,Torque_ozin", 1e3 * t, (203.0 - tip[:, 2:]) / 25.4, -100.0 * f[:, 2:], 1e3 * np.radians(np.unwrap(zyx[:, :1], axis=0, period=360.0)), moment[:, 2:] / 7.061551814226e-3),
        "machine with six axes": lambda: named(
            "Time (s);Z (mm);Angle (deg);Fx (N);Fy (N);Fz (N);Mx (Nmm);My (Nmm);Mz (Nmm)",
            t, tip[:, 2:], np.unwrap(zyx[:, :1], axis=0, period=360.0), f, 1e3 * moment, between=";"),
    }  # fmt: skip


LAYOUTS = {**_curves(), **presses()}
