//! What a drive says of itself in its EEPROM (ETG.2010): identity, mailbox, name, sync managers.

/// Where sync managers 0 to 3 lie: mailbox to the drive and from it, process data to it and from it.
pub(super) const MAILBOX_OUT: u16 = 0x1000;
pub(super) const MAILBOX_IN: u16 = 0x1080;
pub(super) const DATA_OUT: u16 = 0x1100;
pub(super) const DATA_IN: u16 = 0x1180;

/// Length of a mailbox `[byte]`.
pub(super) const MAILBOX: u16 = 128;

/// The EEPROM, in words of two bytes.
pub(super) fn words() -> Vec<u16> {
    let mut out = vec![0_u16; 0x40];
    // Vendor, product, revision, serial number, as pairs of words from 8 on.
    (out[8], out[10], out[12], out[14]) = (0x0b0b, 0x0402, 1, 7);
    // Mailbox to the drive and from it: place and length; protocol: CANopen over EtherCAT.
    out[0x18..0x1d].copy_from_slice(&[MAILBOX_OUT, MAILBOX, MAILBOX_IN, MAILBOX, 0x04]);
    let mut category = |kind: u16, bytes: &[u8]| {
        out.extend([kind, u16::try_from(bytes.len() / 2).unwrap()]);
        out.extend(bytes.chunks(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])));
    };
    // One string: the name.
    category(10, &[1, 6, b'D', b'R', b'I', b'V', b'E', b'1']);
    // The order's name is string 1; SDOs, and lists of process data that may be changed.
    let mut general = [0; 32];
    (general[2], general[3], general[5]) = (1, 1, 0x0d);
    category(30, &general);
    // FMMU 0 for outputs, 1 for inputs.
    category(40, &[1, 2]);
    let manager = |start: u16, length: u16, control: u8, kind: u8| {
        let ([s0, s1], [l0, l1]) = (start.to_le_bytes(), length.to_le_bytes());
        [s0, s1, l0, l1, control, 0, 1, kind]
    };
    let managers = [
        manager(MAILBOX_OUT, MAILBOX, 0x26, 1),
        manager(MAILBOX_IN, MAILBOX, 0x22, 2),
        manager(DATA_OUT, 0, 0x64, 3),
        manager(DATA_IN, 0, 0x20, 4),
    ];
    category(41, managers.as_flattened());
    out.push(0xffff);
    out.extend([0xffff; 4]);
    out
}
