//! Counts instructions of the scoring kernels: `cargo bench -p palpate-core --bench instructions`.
//!
//! A count is the same on a busy machine and an idle one. This program runs itself under Valgrind's
//! callgrind, once per kernel, and fails if one takes more instructions than it may. The limits
//! leave 15 % to the compiler. Without Valgrind it prints a note and counts nothing.
#![expect(clippy::print_stdout, reason = "what a benchmark is for")]
#![expect(clippy::cast_precision_loss, reason = "counts here are small")]

use std::error::Error;
use std::hint::black_box;
use std::process::{Command, ExitCode};

use palpate_core::nmse::Normaliser;
use palpate_core::{Measured, SharedPath};

const N_SIMULATED: usize = 100;
const N_MEASURED: usize = 1000;
const N_SETS: usize = 256;

/// Each kernel with the most instructions that it may take per curve.
const LIMITS: [(&str, f64); 2] = [("score", 1080.0), ("gradient", 6170.0)];

type Outcome<T> = Result<T, Box<dyn Error>>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let outcome = match arguments.iter().position(|a| a == "--kernel") {
        Some(at) => run(&arguments[at + 1], &arguments[at + 2]),
        None => count_all(),
    };
    match outcome {
        Ok(code) => code,
        Err(error) => {
            println!("{error}");
            ExitCode::FAILURE
        }
    }
}

/// Counts every kernel, and reports which takes too many instructions.
fn count_all() -> Outcome<ExitCode> {
    if Command::new("valgrind").arg("--version").output().is_err() {
        println!("SKIPPED: valgrind is not installed, no instruction was counted");
        return Ok(ExitCode::SUCCESS);
    }
    let mut code = ExitCode::SUCCESS;
    println!("{:<12}{:>14}{:>10}", "kernel", "instructions", "limit");
    for (kernel, limit) in LIMITS {
        // What one more round adds: start of the program and making the curves cancel.
        let counted = (counted(kernel, 3)? - counted(kernel, 1)?) / (2 * N_SETS) as f64;
        let verdict = if counted > limit { "  TOO MANY" } else { "" };
        println!("{kernel:<12}{counted:>14.0}{limit:>10.0}{verdict}");
        if counted > limit {
            code = ExitCode::FAILURE;
        }
    }
    Ok(code)
}

/// Instructions of this program when it scores its curves `n_rounds` times.
fn counted(kernel: &str, n_rounds: usize) -> Outcome<f64> {
    let output = Command::new("valgrind")
        .args(["--tool=callgrind", "--callgrind-out-file=/dev/null"])
        .arg(std::env::current_exe()?)
        .args(["--kernel", kernel, &n_rounds.to_string()])
        .output()?;
    let report = String::from_utf8_lossy(&output.stderr);
    let count = report.lines().find_map(|line| line.split("Collected :").nth(1));
    Ok(count.ok_or_else(|| format!("callgrind counted nothing: {report}"))?.trim().parse()?)
}

/// A force ramp of `n` points.
fn ramp(n: usize) -> (Vec<f64>, Vec<f64>) {
    let x: Vec<f64> = (0..n).map(|i| 15.0 * i as f64 / (n - 1) as f64).collect();
    let y = x.iter().map(|x| 0.03 * x * x).collect();
    (x, y)
}

fn run(kernel: &str, n_rounds: &str) -> Outcome<ExitCode> {
    let ((sim_x, sim_y), (exp_x, exp)) = (ramp(N_SIMULATED), ramp(N_MEASURED));
    let path = Measured::new(&exp_x, &exp, Normaliser::MeanAbs, None)?.along(&sim_x)?;
    // Curves far enough from the measured one for the quadratic form to have all its digits.
    let sim: Vec<f64> = (0..N_SETS)
        .flat_map(|k| sim_y.iter().map(move |y| y.sqrt() * (0.5 + k as f64 / N_SETS as f64)))
        .collect();
    for _ in 0..n_rounds.parse()? {
        score(&path, &sim, kernel)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn score(path: &SharedPath, sim: &[f64], kernel: &str) -> Outcome<()> {
    match kernel {
        "gradient" => drop(black_box(path.gradient(sim, N_SETS)?)),
        _ => drop(black_box(path.score(sim, N_SETS)?)),
    }
    Ok(())
}
