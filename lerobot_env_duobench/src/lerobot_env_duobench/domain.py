"""Lets the column `domain` of a data set reach the policy."""

from lerobot.processor import converters

from duobench.lerobot_keys import DOMAIN


def pass_domains_on() -> None:
    """Have LeRobot's processors pass the column on, with the task and the index of a row.

    X-VLA has an option, `domain_feature_key`, that names a column with the domain of each row. The
    processors of LeRobot 0.6 drop all columns but those of a fixed list before X-VLA sees them, and
    then the option does nothing.
    """
    if DOMAIN not in converters._COMPLEMENTARY_KEYS:
        converters._COMPLEMENTARY_KEYS += (DOMAIN,)
