//! A drive by the tables of IEC 61800-7-201, with nothing of what it is tested against but the words it is sent.

use pkm_hal::backends::cia402::DriveOutputs;

/// A drive as the standard draws it: a state, and the transitions that its controlword asks for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    /// Name of the state, as in the standard's figure.
    pub(crate) state: &'static str,
    last: u16,
    pub(crate) torque: i16,
    pub(crate) position: i32,
    /// Torque that it was told before it was in operation: none may be.
    pub(crate) early: i16,
}

impl Drive {
    pub(crate) const NEW: Self = Self { state: "switch on disabled", last: 0, torque: 0, position: 0, early: 0 };

    /// Bits 6, 5, 3, 2, 1, 0 of the statusword of each state, as the standard's table has them.
    pub(crate) fn status(&self) -> u16 {
        // Voltage and remote, which say nothing of the state.
        let others = 0b0000_0010_0001_0000;
        others
            | match self.state {
                "switch on disabled" => 0b0100_0000,
                "ready to switch on" => 0b0010_0001,
                "switched on" => 0b0010_0011,
                "operation enabled" => 0b0010_0111,
                "fault" => 0b0000_1000,
                other => panic!("no state {other}"),
            }
    }

    /// Transitions 2 to 9 and 15 of the standard's figure, one a cycle.
    pub(crate) fn cycle(&mut self, out: &DriveOutputs) {
        assert_eq!(out.mode, 10, "cyclic synchronous torque");
        let (is_voltage, is_quick_stop) = (out.control & 0b10 != 0, out.control & 0b100 != 0);
        let (is_on, is_enabled) = (out.control & 1 != 0, out.control & 0b1000 != 0);
        let is_reset = out.control & 0x80 != 0 && self.last & 0x80 == 0;
        self.state = match self.state {
            "fault" if is_reset => "switch on disabled",
            "fault" => "fault",
            _ if !is_voltage || !is_quick_stop => "switch on disabled",
            "switch on disabled" if !is_on => "ready to switch on",
            "ready to switch on" if is_on => "switched on",
            "switched on" if is_on && is_enabled => "operation enabled",
            "operation enabled" if is_on && is_enabled => "operation enabled",
            "switched on" | "operation enabled" if !is_on => "ready to switch on",
            same => same,
        };
        self.last = out.control;
        let is_operating = self.state == "operation enabled";
        self.early = if is_operating { self.early } else { self.early.max(out.torque.abs()) };
        self.torque = if is_operating { out.torque } else { 0 };
        self.position = self.position.wrapping_add(i32::from(self.torque));
    }
}
