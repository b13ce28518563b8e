//! A hand that holds the drone.

use std::f64::consts::TAU;

/// Frequencies with which it sways in x, y and z. Hz
const SWAY_HZ: [f64; 3] = [0.7, 1.1, 0.9];

/// Speed at which it lowers the drone. m/s
const LOWERING_MPS: f64 = 0.5;

/// Velocity of a hand `t_s` after it has caught the drone: it sways with the amplitude `sway_m` about a place that it
/// lowers by `lowered_m` first. World frame. m/s
pub(crate) fn velocity_w_mps(sway_m: f64, lowered_m: f64, t_s: f64) -> [f64; 3] {
    let [x, y, z] = SWAY_HZ.map(|hz| sway_m * TAU * hz * (TAU * hz * t_s).cos());
    let lowering_mps = if LOWERING_MPS * t_s < lowered_m { LOWERING_MPS } else { 0.0 };
    [x, y, z - lowering_mps]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Way of the hand in the first `for_s`. m
    fn way_w_m(sway_m: f64, lowered_m: f64, for_s: f64) -> [f64; 3] {
        let dt_s = 1e-3;
        let steps = (0..).map(|step| dt_s * f64::from(step)).take_while(|t_s| *t_s < for_s);
        steps.fold([0.0; 3], |at, t_s| {
            let v_mps = velocity_w_mps(sway_m, lowered_m, t_s);
            std::array::from_fn(|row| at[row] + dt_s * v_mps[row])
        })
    }

    #[test]
    fn a_hand_lowers_the_drone_by_so_much_and_no_further() {
        for (for_s, z_m) in [(1.0, -0.5), (1.6, -0.8), (9.0, -0.8)] {
            let at_m = way_w_m(0.0, 0.8, for_s);
            assert!((at_m[2] - z_m).abs() < 2e-3, "{for_s} s: {at_m:?}");
        }
    }

    #[test]
    fn it_sways_about_its_place_by_its_amplitude() {
        for (row, hz) in SWAY_HZ.into_iter().enumerate() {
            let quarter = way_w_m(0.02, 0.0, 0.25 / hz)[row];
            let whole = way_w_m(0.02, 0.0, 1.0 / hz)[row];
            assert!((quarter - 0.02).abs() < 1e-3 && whole.abs() < 1e-3, "{quarter}, {whole} m");
        }
    }
}
