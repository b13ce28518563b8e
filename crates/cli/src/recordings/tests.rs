use super::*;

#[test]
fn numbers_in_names_count_as_numbers() {
    let mut names = ["10.log", "2.log", "flight-2-10.csv", "flight-2-9.csv", "1b.log", "1.log", "001.log"];
    names.sort_by(|a, b| natural(a, b));
    let expected =
        ["001.log", "1.log", "1b.log", "2.log", "10.log", "flight-2-9.csv", "flight-2-10.csv"];
    assert_eq!(names, expected);
}
