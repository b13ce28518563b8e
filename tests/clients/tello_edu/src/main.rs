//! Flies a Tello with the crate tello-edu, by orders of standard input such as `forward 50`.
//!
//! Once the drone is connected and after each order it prints a line `answer TEXT`. An error of the crate ends it.

use std::io::stdin;

use tello_edu::{Result, Tello};

#[tokio::main(flavor = "current_thread")]
async fn main() -> Result<()> {
    let drone = Tello::new().assume_wifi().await?.connect().await?;
    println!("answer connected");
    for order in stdin().lines().map_while(std::result::Result::ok) {
        let (verb, value) = order.split_once(' ').unwrap_or((&order, "0"));
        let value = value.parse().unwrap_or_default();
        let mut answer = "ok".to_owned();
        match verb {
            "battery" => answer = drone.battery().await?.to_string(),
            "take_off" => drone.take_off().await?,
            "forward" => drone.move_forward(value).await?,
            "back" => drone.move_back(value).await?,
            "left" => drone.move_left(value).await?,
            "right" => drone.move_right(value).await?,
            "up" => drone.move_up(value).await?,
            "down" => drone.move_down(value).await?,
            "clockwise" => drone.turn_clockwise(value).await?,
            "counter_clockwise" => drone.turn_counterclockwise(value).await?,
            "flip" => drone.flip_forward().await?,
            "land" => drone.land().await?,
            _ => answer = format!("unknown order {verb}"),
        }
        println!("answer {answer}");
    }
    Ok(())
}
