//! The thin main: arguments in, exit code out.

use std::process::ExitCode;

fn main() -> ExitCode {
    tello_ctl::run()
}
