//! Dates and durations as text: ISO 8601 and RFC 3339, `2024/01/31 12:00:00`,
//! `31.01.2024 12:00:00`, MATLAB's `31-Jan-2024 12:00:00`, `00:01:02.5` and `1.5 sec`.

use crate::decimal::Decimal;

const SECOND: i128 = 10_i128.pow(18);
const MONTHS: [&str; 12] =
    ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"];

/// A time as text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Written {
    /// An instant: attoseconds since 1970-01-01T00:00:00Z.
    Instant(i128),
    /// A date and a time of day without a zone: attoseconds since 1970-01-01T00:00:00 there.
    Local(i128),
    /// A duration in attoseconds.
    Duration(i128),
}

/// Reads a date or a duration; `None` if the text is neither, or leaves open which number is the
/// month.
pub(crate) fn written(text: &str) -> Option<Written> {
    if let Some((number, unit)) = text.split_once(' ')
        && let Some(secs) = [("sec", 1), ("min", 60), ("hr", 3600), ("days", 86_400), ("day", 86_400)]
            .iter()
            .find(|(word, _)| *word == unit)
            .map(|(_, secs)| *secs)
    {
        return Some(Written::Duration(Decimal::parse(number)?.times(secs * SECOND)?));
    }
    if let Some((days, clock_text)) = text.split_once(" days ") {
        let secs = i128::from(whole(days)?) * 86_400 * SECOND;
        return Some(Written::Duration(secs + clock(clock_text, 23)?));
    }
    let at = text.find(['T', 't', ' ']).filter(|at| text[..*at].contains(['-', '/', '.']));
    let Some(at) = at else {
        return Some(Written::Duration(clock(text, u32::MAX)?));
    };
    let days = day(&text[..at])?;
    let rest = &text[at + 1..];
    let end = rest.find(['Z', 'z', '+', '-', ' ']).unwrap_or(rest.len());
    let local = i128::from(days) * 86_400 * SECOND + clock(&rest[..end], 23)?;
    match rest[end..].trim() {
        "" => Some(Written::Local(local)),
        "Z" | "z" | "UTC" | "GMT" => Some(Written::Instant(local)),
        zone => Some(Written::Instant(local - i128::from(offset(zone)?) * SECOND)),
    }
}

/// Reads an offset from UTC such as `+02:00`, `-0530`, `+01` or `Z`, in seconds.
pub fn offset(text: &str) -> Option<i32> {
    if ["Z", "z", "UTC"].contains(&text) {
        return Some(0);
    }
    let (sign, rest) = match text.as_bytes().first()? {
        b'+' => (1, &text[1..]),
        b'-' => (-1, &text[1..]),
        _ => return None,
    };
    let digits: String = match rest.as_bytes() {
        [_, _, b':', _, _] => [&rest[..2], &rest[3..]].concat(),
        [_, _] => format!("{rest}00"),
        [_, _, _, _] => rest.to_owned(),
        _ => return None,
    };
    let hours = whole(digits.get(..2)?)?;
    let minutes = whole(digits.get(2..)?)?;
    (hours < 24 && minutes < 60).then_some(sign * i32::try_from(hours * 3600 + minutes * 60).ok()?)
}

/// Reads `hh:mm:ss` or `hh:mm`, with a fraction of the seconds, in attoseconds.
fn clock(text: &str, last_hour: u32) -> Option<i128> {
    let mut parts = text.split(':');
    let hours = whole(parts.next()?)?;
    let minutes = parts.next()?;
    let secs = parts.next().unwrap_or("0").replace(',', ".");
    let secs = secs.as_str();
    let is_two = |part: &str| part.len() == 2;
    let secs_whole = secs.split('.').next()?;
    // 60 is a leap second.
    let is_clock = parts.next().is_none()
        && hours <= last_hour
        && is_two(minutes)
        && whole(minutes)? < 60
        && (is_two(secs_whole) || secs == "0")
        && whole(secs_whole)? <= 60;
    let minutes = i128::from(hours) * 60 + i128::from(whole(minutes)?);
    let secs = is_clock.then(|| Decimal::parse(secs)?.times(SECOND)).flatten()?;
    Some(minutes * 60 * SECOND + secs)
}

/// Reads a date and returns its number of days after 1970-01-01. Between points the day comes
/// first, unless the year does; between slashes only the year can.
fn day(text: &str) -> Option<i64> {
    let separator = text.chars().find(|c| ['-', '/', '.'].contains(c))?;
    let parts: Vec<&str> = text.split(separator).collect();
    let [first, month, last] = parts[..] else { return None };
    let named = MONTHS.iter().position(|name| month.eq_ignore_ascii_case(name));
    let is_short = |part: &str| if separator == '-' { part.len() == 2 } else { part.len() <= 2 };
    let (year, month, day) = match (named, separator) {
        (Some(index), '-') if first.len() <= 2 && last.len() == 4 => {
            (whole(last)?, index as u32 + 1, whole(first)?)
        }
        (None, _) if first.len() == 4 && is_short(month) && is_short(last) => {
            (whole(first)?, whole(month)?, whole(last)?)
        }
        (None, '.') if is_short(first) && is_short(month) && last.len() == 4 => {
            (whole(last)?, whole(month)?, whole(first)?)
        }
        _ => return None,
    };
    let is_leap = year % 4 == 0 && (year % 100 != 0 || year % 400 == 0);
    let february = if is_leap { 29 } else { 28 };
    let lengths = [31, february, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let length = *lengths.get(month.checked_sub(1)? as usize)?;
    if !(1..=length).contains(&day) {
        return None;
    }
    let before: u32 = lengths[..month as usize - 1].iter().sum();
    let year = i64::from(year);
    // The leap days of the years before this one, counted from the year 0.
    let leaps =
        |year: i64| (year - 1).div_euclid(4) - (year - 1).div_euclid(100) + (year - 1).div_euclid(400);
    Some((year - 1970) * 365 + leaps(year) - leaps(1970) + i64::from(before + day - 1))
}

/// Reads a number of digits only.
fn whole(text: &str) -> Option<u32> {
    let is_whole = !text.is_empty() && text.len() < 10 && text.bytes().all(|byte| byte.is_ascii_digit());
    is_whole.then(|| text.parse().ok()).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn instant(text: &str, secs: i128, nanoseconds: i128) {
        assert_eq!(
            written(text),
            Some(Written::Instant(secs * SECOND + nanoseconds * 10_i128.pow(9))),
            "{text}"
        );
    }

    #[test]
    fn dates_are_those_of_date_from_gnu_coreutils() {
        // `date -u -d TEXT +%s.%N`
        instant("2024-02-29T23:59:59.123456789Z", 1_709_251_199, 123_456_789);
        instant("2024-01-31 12:00:00+02:00", 1_706_695_200, 0);
        instant("2024-01-31T12:00:00-0530", 1_706_722_200, 0);
        instant("1969-12-31T23:59:59Z", -1, 0);
        instant("2100-03-01 00:00:00 UTC", 4_107_542_400, 0);
        instant("2000-03-01T00:00Z", 951_868_800, 0);
        instant("31-Jan-2024 12:00:00 +00:00", 1_706_702_400, 0);
        // The same instant, as a spreadsheet writes it in Japan and in Germany.
        instant("2024/1/31 12:00:00Z", 1_706_702_400, 0);
        instant("31.01.2024 12:00:00Z", 1_706_702_400, 0);
    }

    #[test]
    fn a_date_without_a_zone_is_local_and_a_clock_is_a_duration() {
        assert_eq!(written("2024-01-31 12:00:00"), Some(Written::Local(1_706_702_400 * SECOND)));
        assert_eq!(written("00:01:02.5"), Some(Written::Duration(62_500 * SECOND / 1000)));
        assert_eq!(written("100:00:00"), Some(Written::Duration(360_000 * SECOND)));
        assert_eq!(written("0 days 00:01:02.500000"), Some(Written::Duration(62_500 * SECOND / 1000)));
        assert_eq!(written("2024-01-31 12:00:00,5"), Some(Written::Local(1_706_702_400_500 * SECOND / 1000)));
        assert_eq!(written("1.5 sec"), Some(Written::Duration(1500 * SECOND / 1000)));
    }

    #[test]
    fn what_is_no_date_or_has_two_readings_is_refused() {
        for text in [
            "1/2/2024 12:00",
            "31/01/2024 12:00",
            "2024.1/31 12:00",
            "2024-1-31 12:00",
            "31.1.24 12:00",
            "1.31.2024 12:00",
            "2023-02-29T00:00:00Z",
            "2024-13-01T00:00:00Z",
            "2024-01-01T24:00:00Z",
            "12:60:00",
            "2024-01-01T1:2:3Z",
            "2024-01-01T00:00:00+25:00",
            "2024-01-01",
            "abc",
            "",
            ":",
            "T",
            "-T",
            "2024-01-01T",
            "2024-01-01T00:00:00 CET",
            "é-é-éTé",
            "2024-01-01T00:00:00+é:00",
        ] {
            assert_eq!(written(text), None, "{text}");
        }
    }
}
