//! The shipped robots, described exactly as a user describes theirs: a robot.toml, a URDF and a README that says where every number
//! comes from.
//!
//! The files are embedded as text and nothing else: reading them is the business of `pkm_dyn::urdf::parse`, so that this crate depends
//! on no other.
#![no_std]

/// A shipped robot: the texts of its files and the names they have on disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shipped {
    /// Name, as in its robot.toml and as its URDF is called; a variant lies in the folder of the robot it varies.
    pub name: &'static str,
    /// Text of its robot.toml.
    pub toml: &'static str,
    /// Text of its URDF.
    pub urdf: &'static str,
    /// Path of its robot.toml, from the folder of the shipped robots.
    pub toml_name: &'static str,
    /// Path of its URDF, from the folder of the shipped robots.
    pub urdf_name: &'static str,
    /// Text of its README: measured, published or assumed, for every number.
    pub readme: &'static str,
}

impl Shipped {
    /// The two files of the description as (path, text): robot.toml, then the URDF it names.
    #[must_use]
    pub const fn files(&self) -> [(&'static str, &'static str); 2] {
        [(self.toml_name, self.toml), (self.urdf_name, self.urdf)]
    }
}

macro_rules! shipped {
    ($name:literal) => {
        shipped!($name, $name, "robot.toml")
    };
    // A variant: another robot.toml and URDF beside those of the robot whose folder it is.
    ($name:literal, $folder:literal, $toml:literal) => {
        Shipped {
            name: $name,
            toml: include_str!(concat!($folder, "/", $toml)),
            urdf: include_str!(concat!($folder, "/", $name, ".urdf")),
            toml_name: concat!($folder, "/", $toml),
            urdf_name: concat!($folder, "/", $name, ".urdf"),
            readme: include_str!(concat!($folder, "/README.md")),
        }
    };
}

/// Every shipped robot.
pub const ALL: &[Shipped] = &[
    shipped!("prs3"),
    shipped!("ups3_rpu1"),
    shipped!("ups3_rpu1_start", "ups3_rpu1", "start.toml"),
    shipped!("motobotte"),
    shipped!("motobotte_table", "motobotte", "table.toml"),
    shipped!("ups4"),
    shipped!("five_bar"),
    shipped!("serial_arm"),
    shipped!("serial_arm7"),
];

/// The shipped robot of that name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Shipped> {
    ALL.iter().find(|robot| robot.name == name)
}
