def pytest_addoption(parser):
    parser.addoption(
        "--many", type=int, metavar="N", help="Kills of each set-up of the crash harness."
    )
