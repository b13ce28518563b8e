//! Limits of the supervisor stand in the code, in the documentation of a fault and in `docs/safety.md`: with one value.

use std::io;

use super::repository::document;
use super::words::snake_case;

/// Faults with the constants that their descriptions quote, and the file of these in `crates/flight/src`.
const QUOTED: [(&str, &str, &[&str]); 15] = [
    ("BlockedLong", "supervisor/blocked.rs", &["BLOCKED_MAX_S", "STUCK_S", "STUCK_M"]),
    ("ObstacleApproaches", "supervisor/conditions.rs", &["OBSTACLE_NEAR_S"]),
    ("TrackingLost", "supervisor/conditions.rs", &["OFF_REFERENCE_S", "SUNK_M"]),
    ("TrackingLost", "supervisor/conditions.rs", &["HEADING_OFF_REFERENCE_S"]),
    ("TrackingLost", "supervisor/conditions.rs", &["VELOCITY_OFF_REFERENCE_MPS"]),
    ("TrackingLost", "supervisor/conditions.rs", &["VELOCITY_OFF_REFERENCE_S"]),
    ("TrackingLost", "supervisor/timers.rs", &["HEADING_OFF_REFERENCE_RAD"]),
    ("TrackingLost", "cycle/walls/occupancy.rs", &["BESIDE_M"]),
    (
        "Immobile",
        "supervisor/conditions.rs",
        &["STANDING_ON_OBJECT_S", "STANDING_ON_OBJECT_IN_OUTAGE_S"],
    ),
    ("TooFast", "supervisor/conditions.rs", &["TOO_FAST_S"]),
    ("DeadTimeLong", "supervisor/conditions.rs", &["DEAD_TIME_LONG_S"]),
    ("DeadTimeLong", "cycle/dead_time.rs", &["LEFT_MAX_S", "LEFT_OWN_MAX_S"]),
    ("OutageUnsafe", "supervisor/conditions.rs", &["OUTAGE_UNCONFIRMED_S"]),
    ("TakeOffTimeout", "supervisor/conditions.rs", &["NOT_RISING_S"]),
    ("PersonGone", "supervisor/person_gone.rs", &["GONE_IN_DANGER_S"]),
];

/// Value of the constant `name` of `source` with its unit, as prose has it: `0.45 m`.
fn quantity(source: &str, name: &str) -> Option<String> {
    let rest = source.split(&format!("const {name}: f64 = ")).nth(1)?;
    let value: f64 = rest.split(';').next()?.parse().ok()?;
    let unit = match name.rsplit('_').next()? {
        "MPS" => "m/s",
        "RAD" => "rad",
        "S" => "s",
        "M" => "m",
        _ => return None,
    };
    Some(format!("{value} {unit}"))
}

/// Whether `text` has `quantity`, and not only as a part of another number or unit.
fn quotes(text: &str, quantity: &str) -> bool {
    let text = format!(" {} ", text.split_whitespace().collect::<Vec<_>>().join(" "));
    text.match_indices(&format!(" {quantity}")).any(|(at, found)| {
        let next = text.get(at + found.len()..).and_then(|rest| rest.chars().next());
        next.is_some_and(|c| !c.is_alphanumeric() && c != '/')
    })
}

/// The documentation before the variant `fault` of `source`.
fn doc(source: &str, fault: &str) -> String {
    let before = source.split(&format!("\n    {fault}: ")).next().unwrap_or_default();
    let lines = before.lines().rev().map_while(|line| line.trim().strip_prefix("///"));
    lines.collect::<Vec<_>>().into_iter().rev().collect::<Vec<_>>().join(" ")
}

/// The row of the fault `name` in the table of `page`, and its entry in the list below, if there is one.
fn conditions(page: &str, name: &str) -> String {
    let (row, entry) = (format!("| `{name}` |"), format!("- `{name}`"));
    let row = page.lines().find(|line| line.starts_with(&row));
    let mut below = page.lines().skip_while(|line| !line.starts_with(&entry));
    let entry = below.next();
    let rest = below.take_while(|line| line.starts_with("  "));
    row.into_iter().chain(entry).chain(rest).collect::<Vec<_>>().join(" ")
}

#[test]
fn descriptions_of_a_fault_quote_the_values_of_its_constants() -> io::Result<()> {
    let (safety, faults) =
        (document("docs/safety.md")?, document("crates/flight/src/supervisor/fault.rs")?);
    for (fault, file, constants) in QUOTED {
        let source = document(&format!("crates/flight/src/{file}"))?;
        let text = conditions(&safety, &snake_case(fault));
        for name in constants {
            let quantity = quantity(&source, name).unwrap_or_else(|| panic!("{name} in {file}"));
            assert!(quotes(&text, &quantity), "docs/safety.md, {fault}: {name} is {quantity}");
            assert!(quotes(&doc(&faults, fault), &quantity), "{fault}: {name} is {quantity}");
        }
    }
    Ok(())
}

#[test]
fn a_quantity_is_found_as_a_whole() {
    assert_eq!(quantity("const A_MPS: f64 = 0.60;", "A_MPS").as_deref(), Some("0.6 m/s"));
    assert_eq!(quantity("const A: f64 = 0.6;", "A"), None);
    assert!(quotes("for 3 s,\n more", "3 s") && quotes("or 3\n s", "3 s"));
    assert!(!["1.3 s", "3 steps", "3 s/m"].iter().any(|text| quotes(text, "3 s")));
    let page = "| `a` | no | - |\n| `b` | for 3 s | land |\n\n- `b`: 2 s\n  - 1 s\n- `c`: 4 s\n";
    assert_eq!(conditions(page, "b"), "| `b` | for 3 s | land | - `b`: 2 s   - 1 s");
    assert_eq!(conditions(page, "a"), "| `a` | no | - |");
    assert_eq!(
        doc("    /// No.\n    B: 1;\n    /// For\n    /// 3 s.\n    A: 2;\n", "A"),
        " For  3 s."
    );
}
