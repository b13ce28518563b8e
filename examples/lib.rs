//! Nothing: the examples beside this file use the libraries alone. `cargo run -p horizon-examples --example car`.
