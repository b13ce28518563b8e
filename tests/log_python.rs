//! A log of ours in the hands of a program that we did not write: the `mcap` Python package.

use std::path::Path;
use std::process::Command;

use tello_control::Start;
use tello_ctl::config;
use tello_ctl::cycle::Timing;
use tello_ctl::flight_log::{self, TickRecord};
use tello_ctl::virtual_time::VirtualFlight;
