//! Optical constants by the names of Mitsuba's data files.

use diopter_light::spectrum::Table;

/// `metal,nm,eta,k`, from the last point below 380 nm to the first above 780 nm where there is one. Source: the files of `data/ior` of Mitsuba 3.9.1
/// (<https://github.com/mitsuba-renderer/mitsuba-data>), which name E. D. Palik, "Handbook of Optical Constants of Solids", and luxpop.com as theirs.
const CSV: &str = include_str!("metals.csv");

/// Index of refraction and extinction coefficient over wavelength, linear between the points of the table and even beyond them. `None` for a name that
/// Mitsuba does not know.
pub fn of(name: &str) -> Option<[Table; 2]> {
    // Files of this ending that are the same as those without it are not listed twice.
    let listed = [name, name.strip_suffix("_palik").unwrap_or(name)].into_iter().find(|n| names().any(|listed| listed == *n))?;
    let points: Vec<[f32; 3]> = rows().filter(|row| row.0 == listed).map(|row| row.1).collect();
    Some([1, 2].map(|column| Table::from_points(&points.iter().map(|p| (p[0], p[column])).collect::<Vec<_>>())))
}

/// What is known, in the order of the table.
pub fn names() -> impl Iterator<Item = &'static str> {
    let mut before = "";
    rows().map(|row| row.0).filter(move |name| std::mem::replace(&mut before, name) != *name)
}

/// Name, then wavelength (nm), index and extinction coefficient.
fn rows() -> impl Iterator<Item = (&'static str, [f32; 3])> {
    CSV.lines().skip(1).map(|line| {
        let mut cells = line.split(',');
        let name = cells.next().unwrap_or_default();
        (name, std::array::from_fn(|_| cells.next().and_then(|c| c.parse().ok()).unwrap_or(f32::NAN)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_table_rises_in_wavelength_and_is_a_number_at_each() {
        assert_eq!(names().count(), 41);
        for name in names() {
            let points: Vec<[f32; 3]> = rows().filter(|row| row.0 == name).map(|row| row.1).collect();
            assert!(points.windows(2).all(|w| w[0][0] < w[1][0]), "{name}");
            // Below those of any substance. The file of AlAs has indices of 0.
            assert!(points.iter().all(|p| p[1] >= 0.0 && p[2] >= 0.0 && p[1].max(p[2]) < 10.0), "{name}");
            assert!(name == "AlAs" || points.iter().all(|p| p[1] > 0.0), "{name}");
            assert!(
                of(name).is_some_and(|[n, k]| [380.0, 550.0, 780.0].iter().all(|nm| n.at(*nm) >= 0.0 && k.at(*nm) >= 0.0)),
                "{name}"
            );
        }
    }

    #[test]
    fn metals_have_the_numbers_of_the_handbook() {
        // Palik's tungsten at 589 nm, and nickel, whose file has the longer name alone.
        let [n, k] = of("W").unwrap().map(|t| t.at(589.0));
        assert!((n - 3.54).abs() < 0.1 && (k - 2.84).abs() < 0.1, "{n} {k}");
        assert!(of("Ni_palik").is_some() && of("Ni").is_none() && of("X").is_none());
        // The same numbers under two names; two sources of copper.
        let at = |name: &str| of(name).unwrap().map(|t| t.at(600.0));
        assert_eq!(at("Ir"), at("Ir_palik"));
        assert_ne!(at("Cu"), at("Cu_palik"));
    }
}
