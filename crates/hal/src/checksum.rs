//! CRC-32 of bytes, and a hash of text that is computed while building.

/// Reflected polynomial of CRC-32/ISO-HDLC, the one of Ethernet and zip.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Row 0: what a byte does to the checksum; row `k`: what it does `k` bytes later.
static TABLES: [[u32; 256]; 8] = tables();

const fn tables() -> [[u32; 256]; 8] {
    let mut tables = [[0; 256]; 8];
    let (mut i, mut index) = (0, 0_u32);
    while i < 256 {
        let (mut crc, mut bit) = (index, 0);
        while bit < 8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ POLYNOMIAL } else { crc >> 1 };
            bit += 1;
        }
        tables[0][i] = crc;
        i += 1;
        index += 1;
    }
    let mut k = 1;
    while k < 8 {
        i = 0;
        while i < 256 {
            let before = tables[k - 1][i];
            tables[k][i] = (before >> 8) ^ tables[0][(before & 0xFF) as usize];
            i += 1;
        }
        k += 1;
    }
    tables
}

/// CRC-32/ISO-HDLC of `bytes`.
#[must_use]
pub fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    let mut words = bytes.chunks_exact(8);
    // Eight bytes at a time: every frame passes here several times a period.
    for word in &mut words {
        let low = crc.to_le_bytes();
        crc = (0..8).fold(0, |sum, k| {
            let byte = word[k] ^ low.get(k).copied().unwrap_or(0);
            sum ^ TABLES[7 - k][usize::from(byte)]
        });
    }
    for byte in words.remainder() {
        crc = (crc >> 8) ^ TABLES[0][usize::from(crc.to_le_bytes()[0] ^ byte)];
    }
    !crc
}

/// 64-bit FNV-1a hash of `text`, continued from `start`.
#[must_use]
pub const fn fnv1a(start: u64, text: &str) -> u64 {
    let (bytes, mut hash, mut i) = (text.as_bytes(), start, 0);
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01B3);
        i += 1;
    }
    hash
}

/// Where an FNV-1a hash starts.
pub const FNV_START: u64 = 0xCBF2_9CE4_8422_2325;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_values_of_the_published_catalogues() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32(b""), 0);
        // Of zlib: long enough for whole words and a rest.
        assert_eq!(crc32(b"The quick brown fox jumps over the lazy dog"), 0x414F_A339);
        assert_eq!(fnv1a(FNV_START, "foobar"), 0x8594_4171_F739_67E8);
    }

    #[test]
    fn every_single_flipped_bit_is_noticed() {
        let mut bytes = [0x5A_u8; 64];
        let whole = crc32(&bytes);
        for bit in 0..512 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(crc32(&bytes), whole, "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}
