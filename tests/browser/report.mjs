// Drives a report page as a reader does. Not part of `cargo test`, which opens the page in Chromium
// without clicks (tests/report.rs); needs playwright-core, in any folder outside the repository:
//
//   KINLIGHT_KEEP_REPORT=/tmp/report cargo test --test report everything
//   cd /tmp/browser && npm install playwright-core
//   NODE_PATH=/tmp/browser/node_modules node tests/browser/report.mjs /tmp/report/report.html [SCREENSHOTS]
import assert from 'node:assert/strict';
import { createRequire } from 'node:module';
import { mkdtempSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { pathToFileURL } from 'node:url';

const { chromium } = createRequire(import.meta.url)('playwright-core');
const [page_file, screenshots] = process.argv.slice(2);
const url = pathToFileURL(resolve(page_file)).href;
const browser = await chromium.launchPersistentContext(mkdtempSync(join(tmpdir(), 'report-')), {
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  headless: true,
  args: ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync'],
});
const page = await browser.newPage();
const complaints = [];
page.on('console', message => complaints.push(message.text()));
page.on('pageerror', error => complaints.push(String(error)));
page.on('request', request => {
  if (!request.url().startsWith('data:') && request.url() !== url) complaints.push(request.url());
});
await page.setViewportSize({ width: 1400, height: 900 });
await page.goto(url);

// the border follows the mouse, the keys, and the choice of pictures
const figure = page.locator('.ab').first();
const stage = figure.locator('.ab-stage');
const range = figure.locator('input');
await stage.scrollIntoViewIfNeeded();
const box = await stage.boundingBox();
const middle = box.y + box.height / 2;
await page.mouse.move(box.x + box.width / 2, middle);
await page.mouse.down();
await page.mouse.move(box.x + box.width / 4, middle, { steps: 5 });
await page.mouse.up();
assert.equal(await range.inputValue(), '25');
assert.equal(await stage.evaluate(s => s.style.getPropertyValue('--x')), '25%');
await page.mouse.move(box.x + box.width * 0.9, middle);
assert.equal(await range.inputValue(), '25', 'a mouse that is not pressed moves nothing');
await range.focus();
await page.keyboard.press('ArrowRight');
await page.keyboard.press('ArrowRight');
assert.equal(await range.inputValue(), '27');
await page.keyboard.press('Home');
assert.equal(await stage.evaluate(s => s.style.getPropertyValue('--x')), '0%');
const right = figure.locator('select').nth(1);
await right.selectOption({ index: 2 });
const name = await right.evaluate(s => s.selectedOptions[0].text);
assert.equal(await stage.locator('.ab-right').textContent(), name);
assert.match(await stage.locator('img.b').getAttribute('alt'), new RegExp(`${name}$`));
assert.equal(await stage.locator('img:visible').count(), 2);

for (const link of await page.locator('nav a').all()) {
  const target = await link.getAttribute('href');
  assert.equal(await page.locator(target).count(), 1, target);
}

// nothing is wider than the window, at any width and in both modes
for (const width of [1400, 500]) {
  for (const colorScheme of ['light', 'dark']) {
    await page.emulateMedia({ colorScheme });
    await page.setViewportSize({ width, height: 900 });
    const overflow = await page.evaluate(() =>
      document.documentElement.scrollWidth - document.documentElement.clientWidth);
    assert.ok(overflow <= 0, `${overflow} px too wide at ${width}`);
    if (screenshots) {
      await page.screenshot({ path: join(screenshots, `${width}-${colorScheme}.png`), fullPage: true });
    }
  }
}
if (screenshots) {
  await page.pdf({ path: join(screenshots, 'print.pdf'), format: 'A4' });
}
assert.deepEqual(complaints, []);
await browser.close();
console.log('report page: all checks passed');
