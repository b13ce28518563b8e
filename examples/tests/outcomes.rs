//! Every example identifies, estimates and arrives.

#[expect(dead_code, reason = "main is that of the example")]
#[path = "../car.rs"]
mod car;
#[expect(dead_code, reason = "main is that of the example")]
#[path = "../carriage.rs"]
mod carriage;
#[expect(dead_code, reason = "main is that of the example")]
#[path = "../pendulum.rs"]
mod pendulum;
#[expect(dead_code, reason = "main is that of the example")]
#[path = "../tello.rs"]
mod tello;

#[test]
fn every_example_identifies_estimates_and_arrives() {
    for (name, errors, bounds) in [
        ("car", car::run().unwrap(), [0.03, 0.1, 0.1]),
        ("carriage", carriage::run().unwrap(), [0.02, 0.03, 0.02]),
        ("pendulum", pendulum::run().unwrap(), [0.003, 0.03, 0.05]),
        ("tello", tello::run().unwrap(), [0.02, 0.01, 0.02]),
    ] {
        println!("{name}: parameter, estimate and goal off by {errors:?}");
        let is_good = errors.iter().zip(bounds).all(|(error, bound)| *error < bound);
        assert!(is_good, "{name}: {errors:?}, at most {bounds:?}");
    }
}
